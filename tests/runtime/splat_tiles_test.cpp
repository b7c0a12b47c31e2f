// Which tiles each gaussian is listed in, against the largest alpha in every tile in double precision; and that a list
// never leaves its share.
#define CL_HPP_TARGET_OPENCL_VERSION 120
#define CL_HPP_MINIMUM_OPENCL_VERSION 120
#define CL_TARGET_OPENCL_VERSION 120
#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <set>

#include "runtime/cl.h"
#include "runtime/ops.h"
#include "runtime/ops/splat.h"

using namespace cloam;

namespace {

using Ints = std::vector<int32_t>;

constexpr int kHeight = 71, kWidth = 95, kTile = 16, kCount = 60;
constexpr int kAcross = (kWidth + kTile - 1) / kTile, kDown = (kHeight + kTile - 1) / kTile;

/// [G,7]: round ones and needles, in the picture and beside it, some too faint to be seen anywhere.
std::vector<float> random_splats() {
  std::mt19937 random(11);
  std::uniform_real_distribution<double> one(0, 1);
  std::vector<float> out;
  for (int i = 0; i < kCount; i++) {
    const double along = std::exp(4 * one(random) - 1), across = i % 3 == 0 ? 0.4 : along * (0.3 + 0.7 * one(random));
    const double angle = 3.14159 * one(random), c = std::cos(angle), s = std::sin(angle);
    const double p = 1 / (along * along), q = 1 / (across * across);
    const double opacity = i % 10 == 9 ? 0.002 : 0.005 + 0.9 * one(random);
    for (const double v : {(kWidth + 40) * one(random) - 20, (kHeight + 40) * one(random) - 20, c * c * p + s * s * q,
                           c * s * (p - q), s * s * p + c * c * q, opacity, 1 + one(random)})
      out.push_back(static_cast<float>(v));
  }
  return out;
}

/// The least a dx^2 + 2 b dx dy + c dy^2 for dx in [x0, x1] and dy = y.
double least_on_line(double a, double b, double c, double x0, double x1, double y) {
  const double x = std::clamp(-b * y / a, x0, x1);
  return a * x * x + 2 * b * x * y + c * y * y;
}

/// The largest alpha between a tile's outermost pixel centres, and `more` pixels around.
double largest_alpha(const float* s, int tile, double more) {
  const double left = tile % kAcross * kTile + 0.5 - s[0] - more, top = tile / kAcross * kTile + 0.5 - s[1] - more;
  const double right = left + 15 + 2 * more, bottom = top + 15 + 2 * more;
  if (left <= 0 && right >= 0 && top <= 0 && bottom >= 0) return s[5];
  const double a = s[2], b = s[3], c = s[4];
  const double form = std::min({least_on_line(a, b, c, left, right, top), least_on_line(a, b, c, left, right, bottom),
                                least_on_line(c, b, a, top, bottom, left), least_on_line(c, b, a, top, bottom, right)});
  return s[5] * std::exp(-0.5 * form);
}

}  // namespace

TEST_CASE("a gaussian is listed where it can be seen, from near to far") {
  const std::vector<float> splats = random_splats();
  const SplatTiles found = splat_tiles(from_host(splats, {kCount, 7}), kHeight, kWidth);
  const Ints ids = found.ids.to_host<int32_t>(), offsets = found.offsets.to_host<int32_t>();
  const Ints slots = found.slots.to_host<int32_t>(), first = found.first.to_host<int32_t>();
  REQUIRE(offsets.size() == kAcross * kDown + 1);
  std::set<int32_t> taken;
  int listed = 0, left_out = 0;
  for (int tile = 0; tile < kAcross * kDown; tile++) {
    std::set<int32_t> here;
    float before = 0;
    for (int32_t p = offsets[tile]; p < offsets[tile + 1]; p++) {
      const int32_t id = ids[p];
      CHECK(splats[7 * id + 6] >= before);
      before = splats[7 * id + 6];
      CHECK(here.insert(id).second);
      CHECK(slots[p] >= first[id]);
      CHECK(slots[p] < first[id + 1]);
      CHECK(taken.insert(slots[p]).second);
    }
    for (int32_t id = 0; id < kCount; id++) {
      CAPTURE(tile);
      CAPTURE(id);
      const float* const s = splats.data() + 7 * id;
      if (largest_alpha(s, tile, 0) > 1.001 / 255) CHECK(here.contains(id));
      if (largest_alpha(s, tile, 0.01) < 0.995 / 255) CHECK_FALSE(here.contains(id));
      (here.contains(id) ? listed : left_out)++;
    }
  }
  CHECK(listed > 150);
  CHECK(left_out > 300);
}

TEST_CASE("list_tiles fills its share and writes nowhere else, whatever was counted") {
  constexpr int kBeyond = 40, kUnwritten = -7;
  const Tensor splats = from_host(random_splats(), {kCount, 7}), counts = empty({kCount}, DType::i32);
  const auto [range, chunk] = chunks(kCount, 256);
  launch(kernel("splat_tiles", "count_tiles"), "count_tiles", range, splats, counts, kCount, kAcross, kDown, chunk);
  const Ints right = counts.to_host<int32_t>();
  Ints starts = {0}, order;
  for (int i = 0; i < kCount; i++) {  // as if two kernels had rounded differently
    order.push_back(i);
    starts.push_back(starts.back() + std::max(0, right[i] + std::array{2, -1, 0}[i % 3]));
  }
  const int all = starts.back();
  const auto fresh = [&] { return from_host(Ints(all + kBeyond, kUnwritten), {all + kBeyond}); };
  const Tensor tiles = fresh(), slots = fresh(), owners = fresh(), places = from_host(starts, {kCount + 1});
  launch(kernel("splat_tiles", "list_tiles"), "list_tiles", range, splats, from_host(order, {kCount}), places, places,
         tiles, slots, owners, kCount, kAcross, kDown, chunk);
  const Ints tile = tiles.to_host<int32_t>(), slot = slots.to_host<int32_t>(), owner = owners.to_host<int32_t>();
  for (int i = 0; i < kCount; i++)
    for (int p = starts[i]; p < starts[i + 1]; p++) {
      CHECK((tile[p] >= 0 && tile[p] < kAcross * kDown));
      CHECK(slot[p] == p);
      CHECK(owner[p] == i);
    }
  for (const Ints* list : {&tile, &slot, &owner})
    CHECK(std::all_of(list->begin() + all, list->end(), [](int32_t v) { return v == kUnwritten; }));
}
