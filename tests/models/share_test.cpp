// Several ranks draw what one would have drawn: their batches side by side are its batch.
#include <doctest/doctest.h>

#include <numeric>
#include <set>

#include "models/batches/image_source.h"
#include "models/batches/log_source.h"
#include "models/batches/row_source.h"
#include "tests/models/toy_street.h"

using namespace cloam;

namespace {

constexpr int64_t kRanks = 3;

template <class T>
void append(std::vector<T>& all, const std::vector<T>& more) {
  all.insert(all.end(), more.begin(), more.end());
}

/// What draw(share, so far) adds, rank after rank.
template <class T, class Draw>
std::vector<T> side_by_side(const Draw& draw) {
  std::vector<T> all;
  for (int64_t rank = 0; rank < kRanks; ++rank) append(all, draw(Share{rank, kRanks}));
  return all;
}

template <class T, class Draw>
void check_union(const Draw& draw) {
  CHECK(side_by_side<T>(draw) == draw(Share{}));
}

}  // namespace

TEST_CASE("shares cover every row once, and differ by one row at most") {
  for (const int64_t count : {0, 1, 7, 9}) {
    CAPTURE(count);
    int64_t next = 0;
    for (int64_t rank = 0; rank < kRanks; ++rank) {
      const Share share{rank, kRanks};
      CHECK(share.begin(count) == next);
      CHECK((share.size(count) == count / kRanks || share.size(count) == count / kRanks + 1));
      next = share.end(count);
    }
    CHECK(next == count);
  }
}

TEST_CASE("rows and pixels of all ranks are the batch of one") {
  std::vector<int32_t> from(11);
  std::iota(from.begin(), from.end(), 5);
  check_union<int32_t>([&](const Share& share) { return draw_rows(from, 8, HostRandom(1, 2), share).rows; });
  check_union<float>([&](const Share& share) { return draw_rows(from, 8, HostRandom(1, 2), share).chances; });
  const Folder folder;
  const Scene scene = toy_street(folder.path, {.frames = 3});
  const PixelSource source(scene, toy_pixels(scene), fit_scene(scene), {});
  check_union<float>([&](const Share& share) { return source.draw(50, {4, 5, 0}, share).rgba.to_host(); });
  check_union<float>([&](const Share& share) { return source.draw(50, {4, 5, 0}, share).rays.directions.to_host(); });
  check_union<float>([&](const Share& share) { return source.draw(50, {4, 5, 0}, share, {}, 0.5f).rgba.to_host(); });
}

TEST_CASE("ranks take turns with photographs: every one comes once before any comes again") {
  const Folder folder;
  const Scene scene = toy_street(folder.path, {.frames = 6});
  const PhotoSource source(scene, toy_pixels(scene));
  for (int64_t round = 0; round < 2; ++round) {
    std::set<size_t> seen;
    for (int64_t step = 2 * round + 1; step <= 2 * round + 2; ++step)
      for (int64_t rank = 0; rank < kRanks; ++rank) {
        const size_t drawn = source.draw(9, step, {rank, kRanks});
        CHECK(drawn == source.draw(9, (step - 1) * kRanks + rank + 1, {}));
        seen.insert(drawn);
      }
    CHECK(seen.size() == 6);
  }
}

TEST_CASE("patches and returns of all ranks are the batch of one, and all know of the same actors") {
  const Folder folder;
  Scene scene = toy_street(folder.path, {.frames = 3});
  scene.actors = {toy_actor("ahead", {2, 1, 1.5}, 15, 4), toy_actor("beside", {5, 2, 2}, 9, 2)};
  std::vector<LoadedSweep> sweeps;
  for (const Sweep& sweep : scene.sweeps) sweeps.push_back({&sweep, load_sweep(scene, sweep)});
  const LogSource source(scene, toy_pixels(scene), sweeps, {Eigen::Matrix4d::Identity(), 1});
  const auto drawn = [&](const Share& share) {
    HostRandom random(2, 3);
    RayList rays;
    std::vector<float> numbers = source.add_patches(rays, random, 4, 5, share).truth.to_host();
    const size_t patches = rays.origins.size();
    source.add_returns(rays, random, 60, share);
    return std::tuple(numbers, rays, patches);
  };
  check_union<float>([&](const Share& share) { return std::get<0>(drawn(share)); });
  check_union<float>([&](const Share& share) {
    const auto [numbers, rays, patches] = drawn(share);
    return std::vector<float>(rays.directions.begin(), rays.directions.begin() + static_cast<std::ptrdiff_t>(patches));
  });
  std::multiset<float> ranges;
  for (int64_t rank = 0; rank < kRanks; ++rank) {
    const RayList rays = std::get<1>(drawn({rank, kRanks}));
    CHECK(rays.actors == std::get<1>(drawn({})).actors);
    ranges.insert(rays.ranges.begin(), rays.ranges.end());
  }
  const RayList all = std::get<1>(drawn({}));
  CHECK(ranges == std::multiset<float>(all.ranges.begin(), all.ranges.end()));
}

TEST_CASE("whole images: each rank has its own, and the numbers drawn after them are the same") {
  const Folder folder;
  const Scene scene = toy_street(folder.path, {.frames = 3});
  const LogSource source(scene, toy_pixels(scene), {}, {Eigen::Matrix4d::Identity(), 1});
  std::set<uint64_t> after;
  HostRandom one(3, 1);
  for (int64_t rank = 0; rank < kRanks; ++rank) {
    RayList expected, rays;
    HostRandom random(3, 1);
    const std::vector<float> image = source.add_image(rays, random, {}, {rank, kRanks}).truth.to_host();
    CHECK(image == source.add_image(expected, one, {}, {}).truth.to_host());
    CHECK(rays.directions == expected.directions);
    after.insert(random.next());
  }
  CHECK(after.size() == 1);
}
