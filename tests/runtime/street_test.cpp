// Samples along rays through streets run at once and have no rows: here against a walk in double precision that tries
// every step of every ray.
#include "runtime/ops/street.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <random>

#include "runtime/ops.h"

using namespace cloam;

namespace {

using Vec = std::array<double, 3>;

constexpr double kSlack = 1e-3;  // metres: nearer to an edge than this, rounding decides
constexpr int kCounts[3] = {37, 21, 11};
constexpr double kVoxel = 0.5, kFar = 500;
constexpr Vec kCorner = {-9, -5, -1}, kMiddle = {0.5, -0.25, 1}, kHalf = {4, 3, 1.5};
constexpr StreetSteps kSteps = {.background = 0.3f, .actor = 0.07f, .sky = 5, .shadows = true};

Vec operator+(const Vec& a, const Vec& b) { return {a[0] + b[0], a[1] + b[1], a[2] + b[2]}; }
Vec operator-(const Vec& a, const Vec& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
Vec operator*(double s, const Vec& a) { return {s * a[0], s * a[1], s * a[2]}; }
double dot(const Vec& a, const Vec& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
Vec unit(const Vec& a) { return 1 / std::sqrt(dot(a, a)) * a; }
Vec cross(const Vec& a, const Vec& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

struct Box {
  std::array<Vec, 3> axes;  // rows: box from street
  Vec centre, half;
  double scale;
  int owner;
  Vec turned(const Vec& v) const { return {dot(axes[0], v), dot(axes[1], v), dot(axes[2], v)}; }
};

struct Ray {
  Vec origin, direction;
  double background_shift, actor_shift;
  size_t moment;
};

struct World {
  std::vector<Box> moments[2];
  std::vector<uint8_t> cells, blocks;
  std::vector<Ray> rays;
};

struct Span {
  double from = 0, to = 1e30, enters = 0;
};

/// Where a ray is within |p| < half, before its origin nothing.
std::optional<Span> span_in(const Vec& p, const Vec& d, const Vec& half) {
  Span span;
  for (size_t k = 0; k < 3; k++) {
    if (d[k] == 0) {
      if (std::abs(p[k]) >= half[k]) return {};
      continue;
    }
    const double a = (-half[k] - p[k]) / d[k], b = (half[k] - p[k]) / d[k];
    span.from = std::max(span.from, std::min(a, b));
    span.to = std::min(span.to, std::max(a, b));
  }
  span.enters = span.from;
  return span.from < span.to ? std::optional(span) : std::nullopt;
}

size_t cell(int x, int y, int z) {
  return (static_cast<size_t>(z) * kCounts[1] + static_cast<size_t>(y)) * kCounts[0] + static_cast<size_t>(x);
}

bool occupied(const World& world, const Vec& p) {
  int c[3];
  for (size_t k = 0; k < 3; k++) {
    c[k] = static_cast<int>(std::floor((p[k] - kCorner[k]) / kVoxel));
    if (c[k] < 0 || c[k] >= kCounts[k]) return false;
  }
  return world.cells[cell(c[0], c[1], c[2])] != 0;
}

Vec contracted(const Vec& p) {
  Vec x;
  for (size_t k = 0; k < 3; k++) x[k] = (p[k] - kMiddle[k]) / kHalf[k];
  const double norm = std::max({std::abs(x[0]), std::abs(x[1]), std::abs(x[2])});
  const Vec folded = norm > 1 ? (2 - 1 / norm) / norm * x : x;
  return 0.25 * folded + Vec{0.5, 0.5, 0.5};
}

/// A place on a ray that has a sample, or may have one where rounding decides.
struct Wanted {
  double t;
  const Box* box;  // none: background
  bool sure, found = false;
};

struct Walk {
  std::vector<Wanted> samples;
  std::vector<std::pair<const Box*, Span>> spans;  // apart from each other, by distance
  double edge = 1;
};

Walk walk(const World& world, const Ray& ray) {
  Walk out;
  for (const Box& box : world.moments[ray.moment])
    if (const auto span = span_in(box.turned(ray.origin - box.centre), box.turned(ray.direction), box.half))
      out.spans.push_back({&box, *span});
  std::stable_sort(out.spans.begin(), out.spans.end(),
                   [](const auto& a, const auto& b) { return a.second.from < b.second.from; });
  double taken = 0;
  for (auto& [box, span] : out.spans) {
    span.from = std::max(span.from, taken);
    span.to = taken = std::max(span.to, span.from);
    for (int k = 0; k < 2000; k++) {
      const double t = span.enters + (k + ray.actor_shift) * double{kSteps.actor};
      const double within = std::min(t - span.from, span.to - t);
      if (within > -kSlack) out.samples.push_back({t, box, within > kSlack});
    }
  }
  const Vec half = {kCounts[0] * kVoxel / 2, kCounts[1] * kVoxel / 2, kCounts[2] * kVoxel / 2};
  if (const auto grid = span_in(ray.origin - kCorner - half, ray.direction, half)) out.edge = grid->to;
  out.edge = std::max(out.edge, taken);
  for (int k = 0; k < 400; k++) {
    const double t = (k + ray.background_shift) * double{kSteps.background};
    int in = 0;
    for (int corner = 0; corner < 8; corner++)
      in += occupied(world, ray.origin + t * ray.direction +
                                kSlack * Vec{corner & 1 ? 1. : -1., corner & 2 ? 1. : -1., corner & 4 ? 1. : -1.});
    double free = 1e30;  // how far from the actors
    for (const auto& [box, span] : out.spans)
      if (span.to > span.from) free = std::min(free, std::max(span.from - t, t - span.to));
    if (in > 0 && free > -kSlack) out.samples.push_back({t, nullptr, in == 8 && free > kSlack});
  }
  return out;
}

Box random_box(std::mt19937& random, int owner) {
  std::uniform_real_distribution<double> one(-1, 1);
  Box box;
  box.axes[0] = unit({one(random), one(random), 0.2 * one(random)});
  box.axes[2] = unit(cross(box.axes[0], {0.1 * one(random), -1, 0.1}));
  box.axes[1] = cross(box.axes[2], box.axes[0]);
  box.centre = {7 * one(random), 4 * one(random), 1 + one(random)};
  box.half = {1 + 0.4 * one(random), 1.7 + one(random), 0.8 + 0.3 * one(random)};
  box.scale = 0.5 / 2.9;
  box.owner = owner;
  return box;
}

/// Two moments, the second with no box in common; a grid of which whole blocks are empty; rays from everywhere.
World random_world() {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> one(-1, 1);
  World world;
  for (int owner = 0; owner < 6; owner++) world.moments[0].push_back(random_box(random, owner));
  for (int owner = 3; owner < 10; owner++) world.moments[1].push_back(random_box(random, owner));
  world.cells.assign(cell(0, 0, kCounts[2]), 0);
  const int blocks[3] = {(kCounts[0] + 7) / 8, (kCounts[1] + 7) / 8, (kCounts[2] + 7) / 8};
  world.blocks.assign(static_cast<size_t>(blocks[0] * blocks[1] * blocks[2]), 0);
  for (int z = 0; z < kCounts[2]; z++)
    for (int y = 0; y < kCounts[1]; y++)
      for (int x = 0; x < kCounts[0]; x++) {
        const bool empty_block = (x / 8 + y / 8 + z / 8) % 2 == 1;
        if (empty_block || one(random) < 0) continue;
        world.cells[cell(x, y, z)] = 1;
        world.blocks[static_cast<size_t>(((z / 8) * blocks[1] + y / 8) * blocks[0] + x / 8)] = 1;
      }
  for (size_t i = 0; i < 160; i++) {
    Ray ray{{7 * one(random), 4 * one(random), 1 + one(random)},
            unit({one(random), one(random), 0.3 * one(random)}),
            0.5 + 0.499 * one(random),
            0.5 + 0.499 * one(random),
            i % 2};
    if (i % 4 == 1) ray.origin = ray.origin - 25. * ray.direction;                         // from outside
    if (i % 4 == 2) ray.direction = {0, 0, 0}, ray.direction[i % 3] = i % 8 < 4 ? 1 : -1;  // along an axis
    if (i % 16 == 3) ray.origin = {60, 70, 80};                                            // past everything
    if (i % 16 == 7) ray.origin = world.moments[i % 2][i % 5].centre;                      // in an actor
    world.rays.push_back(ray);
  }
  return world;
}

void append(std::vector<float>& to, const Vec& v) {
  for (const double x : v) to.push_back(static_cast<float>(x));
}

template <size_t count>
std::array<float, count> rounded(const std::vector<Vec>& from) {
  std::array<float, count> out;
  for (size_t k = 0; k < count; k++) out[k] = static_cast<float>(from[k / 3][k % 3]);
  return out;
}

StreetSamples samples_of(const World& world, const StreetSteps& steps) {
  std::vector<float> origins, directions, jitter;
  std::vector<int32_t> moments;
  std::vector<std::vector<StreetBox>> packed;
  for (const Ray& ray : world.rays) {
    append(origins, ray.origin);
    append(directions, ray.direction);
    jitter.insert(jitter.end(), {static_cast<float>(ray.background_shift), static_cast<float>(ray.actor_shift)});
    moments.push_back(static_cast<int32_t>(ray.moment));
  }
  for (const auto& boxes : world.moments) {
    packed.emplace_back();
    for (const Box& box : boxes)
      packed.back().push_back({rounded<9>({box.axes[0], box.axes[1], box.axes[2]}), rounded<3>({box.centre}),
                               rounded<3>({box.half}), static_cast<float>(box.scale), static_cast<float>(box.owner)});
  }
  std::vector<float> grid;
  append(grid, kCorner);
  grid.push_back(static_cast<float>(kVoxel));
  for (const int n : kCounts) grid.push_back(static_cast<float>(n));
  append(grid, kMiddle);
  append(grid, kHalf);
  grid.insert(grid.end(), {static_cast<float>(kFar), 0, 0});
  const auto count = static_cast<int64_t>(world.rays.size());
  const Shape cells = {kCounts[2], kCounts[1], kCounts[0]};
  const Shape blocks = {(kCounts[2] + 7) / 8, (kCounts[1] + 7) / 8, (kCounts[0] + 7) / 8};
  return street_samples({from_host(origins, {count, 3}), from_host(directions, {count, 3}),
                         from_host(jitter, {count, 2}), from_host(moments, {count})},
                        pack_boxes(packed),
                        {from_host(world.cells, cells), from_host(world.blocks, blocks), from_host(grid, {16})}, steps);
}

/// All that street_samples gives, on the host.
struct Read {
  explicit Read(const StreetSamples& s)
      : offsets(s.offsets.to_host<int32_t>()),
        rows(s.rows.to_host<int32_t>()),
        ray(s.ray.to_host<int32_t>()),
        owners(s.owners.to_host<int32_t>()),
        t(s.t.to_host()),
        points(s.points.to_host()),
        actor_points(s.actor_points.to_host()),
        actor_directions(s.actor_directions.to_host()) {}
  size_t first(size_t r) const { return static_cast<size_t>(offsets[r]); }
  size_t row(size_t place) const { return static_cast<size_t>(rows[place]); }
  bool is_actor(size_t place) const { return row(place) >= ray.size(); }
  size_t actor_row(size_t place) const { return row(place) - ray.size(); }
  int owner(size_t place) const { return is_actor(place) ? owners[actor_row(place)] : -1; }
  std::vector<int32_t> offsets, rows, ray, owners;
  std::vector<float> t, points, actor_points, actor_directions;
};

double apart(const std::vector<float>& values, size_t row, const Vec& want) {
  double most = 0;
  for (size_t k = 0; k < 3; k++) most = std::max(most, std::abs(double{values[3 * row + k]} - want[k]));
  return most;
}

const World& world() {
  static const World made = random_world();
  return made;
}

const StreetSamples& samples() {
  static const StreetSamples taken = samples_of(world(), kSteps);
  return taken;
}

/// What a comparison met: samples, boxes that begin in others, the most boxes on one ray.
struct Compared {
  size_t actors = 0, background = 0, covered = 0, most = 0;
};

Compared compare(const World& world, const StreetSamples& samples) {
  const Read s(samples);
  Compared out;
  std::vector<int> seen(s.t.size(), 0);
  for (size_t r = 0; r < world.rays.size(); r++) {
    CAPTURE(r);
    const Ray& ray = world.rays[r];
    Walk want = walk(world, ray);
    for (size_t i = 1; i < want.spans.size(); i++)
      out.covered += want.spans[i].second.from > want.spans[i].second.enters;
    out.most = std::max(out.most, want.spans.size());
    const size_t last = s.first(r + 1) - static_cast<size_t>(kSteps.sky);
    REQUIRE(s.first(r) <= last);
    double before = 0;
    for (size_t i = s.first(r); i < last; i++) {
      const double t = double{s.t[i]};
      CAPTURE(t);
      CHECK(t >= before);
      before = t;
      seen[s.row(i)]++;
      const auto near = std::find_if(want.samples.begin(), want.samples.end(), [&](const Wanted& w) {
        return !w.found && std::abs(w.t - t) < 2 * kSlack && (w.box ? w.box->owner : -1) == s.owner(i);
      });
      REQUIRE(near != want.samples.end());
      near->found = true;
      const Vec at = ray.origin + t * ray.direction;
      if (near->box == nullptr) {
        out.background++;
        CHECK(s.ray[s.row(i)] == static_cast<int>(r));
        CHECK(apart(s.points, s.row(i), contracted(at)) < 1e-5);
      } else {
        out.actors++;
        const Box& box = *near->box;
        CHECK(apart(s.actor_points, s.actor_row(i), box.scale * box.turned(at - box.centre) + Vec{0.5, 0.5, 0.5}) <
              1e-5);
        CHECK(apart(s.actor_directions, s.actor_row(i), box.turned(ray.direction)) < 1e-5);
      }
    }
    for (const Wanted& w : want.samples) {
      CAPTURE(w.t);
      CHECK((w.found || !w.sure));
    }
    for (int k = 0; k < kSteps.sky; k++) {
      const size_t i = last + static_cast<size_t>(k);
      REQUIRE_FALSE(s.is_actor(i));
      seen[s.row(i)]++;
      CHECK(s.ray[s.row(i)] == static_cast<int>(r));
      CHECK(s.t[i] == doctest::Approx(-want.edge).epsilon(1e-4));
      const double share = (k + ray.background_shift) / kSteps.sky;
      const double t = 1 / ((1 - share) / want.edge + share / std::max(kFar, 2 * want.edge));
      CHECK(apart(s.points, s.row(i), contracted(ray.origin + t * ray.direction)) < 1e-4);
    }
  }
  CHECK(std::all_of(seen.begin(), seen.end(), [](int times) { return times == 1; }));
  CHECK(s.ray.size() + s.owners.size() == s.t.size());
  return out;
}

/// Opacities by row, mostly low, some that nothing is seen behind.
std::vector<float> random_alpha(size_t count) {
  std::mt19937 random(3);
  std::uniform_real_distribution<float> uniform(0, 1);
  std::vector<float> alpha(count);
  for (float& a : alpha) a = uniform(random) < 0.08f ? 0.97f : 0.15f * uniform(random);
  return alpha;
}

}  // namespace

TEST_CASE("street samples are those of a walk that tries every step") {
  const Compared met = compare(world(), samples());
  CHECK(met.actors > 500);
  CHECK(met.background > 500);
  CHECK(met.covered > 10);
}

TEST_CASE("a ray through many boxes has samples in all of them") {
  World crowd = world();
  crowd.rays.resize(40);
  const Box upright = {{Vec{1, 0, 0}, Vec{0, 1, 0}, Vec{0, 0, 1}}, {}, {}, 0.5 / 9, 0};
  for (auto& boxes : crowd.moments) boxes.clear();
  for (int owner = 0; owner < 170; owner++) {  // a queue along x that overlaps here and there, in no order
    Box box = upright;
    const int place = owner * 67 % 170;
    box.centre = {-8.5 + 0.1 * place, 0.1 * std::sin(place), 1};
    box.half = {place % 3 == 0 ? 0.073 : 0.041, 2, 1.5};
    box.owner = owner;
    crowd.moments[0].push_back(box);
  }
  for (int owner = 0; owner < 130; owner++) {  // one around the other: who starts within enters all at once
    Box box = upright;
    const double size = 0.3 + 0.031 * (owner * 29 % 130);
    box.half = {size, size, size};
    box.owner = owner;
    crowd.moments[1].push_back(box);
  }
  for (size_t i = 0; i < crowd.rays.size(); i++) {
    Ray& ray = crowd.rays[i];
    const double slope = 0.003 * static_cast<double>(i);
    if (i % 2 == 0) ray.origin = {-9.3, 0.1, 1.1}, ray.direction = unit({1, slope, -0.5 * slope});
    if (i % 4 == 1) ray.origin = {0.1, 0.05, -0.1};
  }
  const Compared met = compare(crowd, samples_of(crowd, kSteps));
  CHECK(met.most == 170);
  CHECK(met.actors > 2000);
}

TEST_CASE("shadows' places lie on the ground below the boxes") {
  const StreetSamples& s = samples();
  const auto offsets = s.shadow_offsets.to_host<int32_t>(), owners = s.shadow_owners.to_host<int32_t>(),
             rays = s.shadow_ray.to_host<int32_t>();
  const auto points = s.shadow_points.to_host(), directions = s.shadow_directions.to_host(), ts = s.shadow_t.to_host();
  size_t places = 0;
  for (size_t r = 0; r < world().rays.size(); r++) {
    const Ray& ray = world().rays[r];
    CAPTURE(r);
    for (const Box& box : world().moments[ray.moment]) {
      const Vec o = box.turned(ray.origin - box.centre), d = box.turned(ray.direction);
      const double t = (-box.half[2] - o[2]) / d[2];
      const Vec hit = o + t * d;
      const double within = d[2] < 0 && t > 0 ? std::min(2 * box.half[0] - std::abs(hit[0]),  //
                                                         2 * box.half[1] - std::abs(hit[1]))
                                              : -1;
      if (std::abs(within) < kSlack || std::abs(d[2]) < 0.01) continue;  // rounding decides
      int found = 0;
      for (auto i = static_cast<size_t>(offsets[r]); i < static_cast<size_t>(offsets[r + 1]); i++) {
        if (owners[i] != box.owner) continue;
        found++;
        CHECK(rays[i] == static_cast<int>(r));
        CHECK(ts[i] == doctest::Approx(t).epsilon(1e-4));
        CHECK(apart(points, i, 0.5 * box.scale * hit + Vec{0.5, 0.5, 0.5}) < 1e-4);
        CHECK(apart(directions, i, d) < 1e-5);
      }
      CHECK(found == (within > 0));
      places += static_cast<size_t>(found);
    }
  }
  CHECK(places > 30);
  StreetSteps without = kSteps;
  without.shadows = false;
  CHECK(samples_of(world(), without).shadow_owners.dim(0) == 0);
}

TEST_CASE("what a LiDAR sees in an occupied voxel has a sample within a step") {
  World empty = world();
  for (auto& boxes : empty.moments) boxes.clear();
  empty.moments[0].push_back(world().moments[0].front());
  empty.moments[0].front().centre = {0, 0, 1000};
  empty.rays.clear();
  std::vector<double> ranges;
  std::mt19937 random(5);
  std::uniform_real_distribution<double> uniform(0, 1);
  for (int z = 0; z < kCounts[2]; z++)
    for (int y = 0; y < kCounts[1]; y++)
      for (int x = 0; x < kCounts[0]; x += 3) {
        if (!empty.cells[cell(x, y, z)]) continue;
        const Vec lidar = {-1 + uniform(random), uniform(random), 2};
        const Vec way = kCorner + kVoxel * Vec{x + 0.5, y + 0.5, z + 0.5} - lidar;
        ranges.push_back(std::sqrt(dot(way, way)));
        empty.rays.push_back({lidar, unit(way), uniform(random), uniform(random), 0});
      }
  const Read s(samples_of(empty, kSteps));
  REQUIRE(ranges.size() > 500);
  for (size_t r = 0; r < ranges.size(); r++) {
    double nearest = 1e30;
    for (size_t i = s.first(r); i < s.first(r + 1); i++)
      nearest = std::min(nearest, std::abs(double{s.t[i]} - ranges[r]));
    CHECK(nearest <= double{kSteps.background});
  }
}

TEST_CASE("street_lit keeps what light reaches, and the last sample") {
  constexpr float kLeast = 0.05f;
  const Read all(samples());
  const std::vector<float> alpha = random_alpha(all.t.size());
  const StreetSamples kept_samples =
      street_lit(samples(), from_host(alpha, {static_cast<int64_t>(alpha.size())}), kLeast);
  const Read kept(kept_samples);
  size_t at = 0, dark = 0;
  for (size_t r = 0; r < world().rays.size(); r++) {
    CAPTURE(r);
    REQUIRE(kept.first(r) == at);
    float through = 1;
    for (size_t i = all.first(r); i < all.first(r + 1); i++) {
      const bool reached = through >= kLeast;
      through *= 1 - alpha[all.row(i)];
      if (!reached && i + 1 < all.first(r + 1)) {
        dark++;
        continue;
      }
      REQUIRE(at < kept.t.size());
      CHECK(kept.t[at] == all.t[i]);
      REQUIRE(kept.owner(at) == all.owner(i));
      const auto same = [&](const std::vector<float>& to, size_t to_row, const std::vector<float>& from, size_t row) {
        return std::equal(to.begin() + static_cast<std::ptrdiff_t>(3 * to_row),
                          to.begin() + static_cast<std::ptrdiff_t>(3 * to_row + 3),
                          from.begin() + static_cast<std::ptrdiff_t>(3 * row));
      };
      if (all.is_actor(i)) {
        CHECK(same(kept.actor_points, kept.actor_row(at), all.actor_points, all.actor_row(i)));
        CHECK(same(kept.actor_directions, kept.actor_row(at), all.actor_directions, all.actor_row(i)));
      } else {
        CHECK(kept.ray[kept.row(at)] == static_cast<int>(r));
        CHECK(same(kept.points, kept.row(at), all.points, all.row(i)));
      }
      at++;
    }
  }
  CHECK(at == kept.t.size());
  CHECK(dark > 200);
  CHECK(kept_samples.shadow_ray.to_host<int32_t>() == samples().shadow_ray.to_host<int32_t>());
}

TEST_CASE("street_owners names the actor that more than half of a ray's light comes from") {
  const Read s(samples());
  const std::vector<float> alpha = random_alpha(s.t.size());
  const auto seen = street_owners(from_host(alpha, {static_cast<int64_t>(alpha.size())}), samples()).to_host<int32_t>();
  REQUIRE(seen.size() == world().rays.size());
  size_t named = 0, nobody = 0;
  for (size_t r = 0; r < seen.size(); r++) {
    CAPTURE(r);
    std::vector<double> light(10, 0.);
    double through = 1;
    for (size_t i = s.first(r); i < s.first(r + 1); i++) {
      if (s.is_actor(i)) light[static_cast<size_t>(s.owner(i))] += through * double{alpha[s.row(i)]};
      through *= 1 - double{alpha[s.row(i)]};
    }
    const auto most = std::max_element(light.begin(), light.end());
    if (std::abs(*most - 0.5) < 1e-4) continue;  // rounding decides
    const int want = *most > 0.5 ? static_cast<int>(most - light.begin()) : -1;
    CHECK(seen[r] == want);
    (want < 0 ? nobody : named)++;
  }
  CHECK(named > 20);
  CHECK(nobody > 20);
}
