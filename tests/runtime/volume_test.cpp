// Marching, visibility and the occupancy cells run at once and have no rows: here against loops on the host.
#include "runtime/ops/volume.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "runtime/ops.h"

using namespace cloam;

namespace {

struct HostSamples {
  std::vector<int> offsets = {0};
  std::vector<double> t, dt;
};

int host_cell(const double point[3], bool contract, int side) {
  const double m = std::max({std::abs(point[0]), std::abs(point[1]), std::abs(point[2])});
  const double fold = m > 1 ? (2 - 1 / m) / m : 1;
  int at[3];
  for (int k = 0; k < 3; k++) {
    const double unit = contract ? point[k] * fold / 4 + 0.5 : point[k] / 2 + 0.5;
    at[k] = std::clamp(static_cast<int>(unit * side), 0, side - 1);
  }
  return (at[2] * side + at[1]) * side + at[0];
}

constexpr int kSide = 8;

std::vector<float> checkered_cells() {
  std::vector<float> cells(kSide * kSide * kSide);
  for (size_t i = 0; i < cells.size(); i++)
    cells[i] = (i % kSide + i / kSide % kSide + i / kSide / kSide) % 3 == 0 ? 2.f : 0.25f;
  return cells;
}

/// Steps of this length through the cells that hold 2.
MarchOptions through_checkers(float step) {
  MarchOptions m;
  m.side = kSide;
  m.min_step = step;
  m.threshold = 0.5f;
  return m;
}

struct Setup {
  std::vector<float> origins = {0, 0, -3, 0.3f, -2.5f, 0.1f, 0.05f, 0.02f, 0.01f, 5, 5, 5};
  std::vector<float> directions = {0, 0, 1, 0.1f, 0.99f, 0.1f, 0.6f, 0, 0.8f, 0, 1, 0};
  std::vector<float> span = {2, 4, 0.5f, 6, 0.05f, 20, 3, 1};
  std::vector<float> jitter = {0, 0.5f, 0.9f, 0.3f};
};

HostSamples host_march(const Setup& setup, const std::vector<float>& cells, const MarchOptions& m) {
  HostSamples out;
  for (size_t r = 0; r < 4; r++) {
    const auto step = [&](double t) { return std::clamp(t * m.cone, double{m.min_step}, double{m.max_step}); };
    double t = setup.span[2 * r];
    t += setup.jitter[r] * step(t);
    const size_t full = out.t.size() + static_cast<size_t>(m.capacity);
    while (t < setup.span[2 * r + 1] && out.t.size() < full) {
      double point[3];
      const double dt = step(t);
      for (size_t k = 0; k < 3; k++) point[k] = setup.origins[3 * r + k] + (t + dt / 2) * setup.directions[3 * r + k];
      const float value = cells[static_cast<size_t>(host_cell(point, m.contract, m.side))];
      if (value > m.threshold) {
        out.t.push_back(t + dt / 2);
        out.dt.push_back(dt);
      }
      t += dt;
    }
    out.offsets.push_back(static_cast<int>(out.t.size()));
  }
  return out;
}

RaySamples device_march(const Setup& setup, const std::vector<float>& cells, const MarchOptions& m) {
  const Rays rays{from_host(setup.origins, {4, 3}), from_host(setup.directions, {4, 3}), from_host(setup.span, {4, 2})};
  return march(rays, from_host(setup.jitter, {4}), from_host(cells, {static_cast<int64_t>(cells.size())}), m);
}

void compare(const RaySamples& found, const HostSamples& want) {
  REQUIRE(found.offsets.to_host<int32_t>() == std::vector<int32_t>(want.offsets.begin(), want.offsets.end()));
  const std::vector<float> t = found.t.to_host(), dt = found.dt.to_host();
  const std::vector<int32_t> ray = found.ray.to_host<int32_t>();
  for (size_t s = 0; s < want.t.size(); s++) {
    CHECK(t[s] == doctest::Approx(want.t[s]).epsilon(1e-4));
    CHECK(dt[s] == doctest::Approx(want.dt[s]).epsilon(1e-4));
    CHECK(static_cast<int>(s) >= want.offsets[static_cast<size_t>(ray[s])]);
    CHECK(static_cast<int>(s) < want.offsets[static_cast<size_t>(ray[s]) + 1]);
  }
}

}  // namespace

TEST_CASE("marching keeps the steps through occupied cells of a box") {
  const MarchOptions m = through_checkers(0.0513f);
  const Setup setup;
  const HostSamples want = host_march(setup, checkered_cells(), m);
  CHECK(want.t.size() > 20);
  compare(device_march(setup, checkered_cells(), m), want);
}

TEST_CASE("marching keeps as many samples of a ray as it may, to the last") {
  MarchOptions m = through_checkers(0.0513f);
  m.capacity = 3;
  const Setup setup;
  const HostSamples want = host_march(setup, checkered_cells(), m);
  CHECK(std::adjacent_find(want.offsets.begin(), want.offsets.end(), [](int a, int b) { return b - a == 3; }) !=
        want.offsets.end());
  compare(device_march(setup, checkered_cells(), m), want);
}

TEST_CASE("marching through a contracted scene lengthens its steps") {
  MarchOptions m = through_checkers(0.0317f);
  m.contract = true;
  m.cone = 0.07f;
  const Setup setup;
  const HostSamples want = host_march(setup, checkered_cells(), m);
  CHECK(want.t.size() > 15);
  compare(device_march(setup, checkered_cells(), m), want);
}

TEST_CASE("exploring looks into few empty cells, and never leaves out a full one") {
  MarchOptions m = through_checkers(0.01f);
  const Setup setup;
  const auto count = [&](int explore) {
    m.explore = explore;
    return device_march(setup, checkered_cells(), m).t.dim(0);
  };
  const int64_t plain = count(0);
  int64_t added = 0;
  for (int step = 1; step <= 64; step++) {
    const int64_t seen = count(step);
    CHECK(seen >= plain);
    added += seen - plain;
  }
  m.explore = 0;
  m.threshold = -1;
  const int64_t empty_steps = count(0) - plain;
  CHECK(added > empty_steps / 4);  // one in 64, over 64 steps: about every empty cell once
  CHECK(added < empty_steps * 4);
}

TEST_CASE("visible keeps each ray's samples up to where its light is spent") {
  MarchOptions m;
  m.side = kSide;
  m.min_step = 0.05f;
  m.threshold = -1;
  const RaySamples all = device_march({}, checkered_cells(), m);
  const std::vector<float> dt = all.dt.to_host(), t = all.t.to_host();
  const std::vector<int32_t> offsets = all.offsets.to_host<int32_t>();
  std::vector<float> sigma(dt.size());
  for (size_t i = 0; i < sigma.size(); i++) sigma[i] = static_cast<float>(i % 7) * 1.3f;
  const RaySamples lit = visible(all, from_host(sigma, {static_cast<int64_t>(sigma.size())}), 0.05f);
  std::vector<float> want;
  for (size_t r = 0; r + 1 < offsets.size(); r++) {
    double through = 1;
    for (auto s = static_cast<size_t>(offsets[r]); s < static_cast<size_t>(offsets[r + 1]) && through > 0.05; s++) {
      want.push_back(t[s]);
      through *= std::exp(-double{sigma[s]} * dt[s]);
    }
  }
  CHECK(want.size() < t.size());
  CHECK(lit.t.to_host() == want);
}

TEST_CASE("occupancy cells repeat none, their points lie inside, and merging keeps decayed maxima") {
  const int side = 6;
  const OccupancyCells found = occupancy_cells(random_uniform({200, 3}, {1, 2, 3}), side, 17, 1000003 % (6 * 6 * 6));
  const std::vector<int32_t> cells = found.cells.to_host<int32_t>();
  const std::vector<float> points = found.points.to_host();
  CHECK(std::set<int32_t>(cells.begin(), cells.end()).size() == 200);
  for (size_t i = 0; i < cells.size(); i++) {
    const int at[3] = {cells[i] % side, cells[i] / side % side, cells[i] / side / side};
    for (size_t k = 0; k < 3; k++) CHECK(static_cast<int>(points[3 * i + k] * side) == at[k]);
  }
  Tensor values = from_host(std::vector<float>(216, 3.f), {216});
  occupancy_merge(values, from_host(std::vector<int32_t>{5, 100, 0}, {3}),
                  from_host(std::vector<float>{1, 4, 2.5f}, {3}), 0.5f);
  const std::vector<float> merged = values.to_host();
  CHECK(merged[5] == 1.5f);
  CHECK(merged[100] == 4.f);
  CHECK(merged[0] == 2.5f);
  CHECK(merged[7] == 3.f);
}
