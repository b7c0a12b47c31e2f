// See scene.h.
#include "models/scene/scene.h"

#include <algorithm>
#include <numeric>

#include "runtime/error.h"

namespace cloam {

std::vector<std::size_t> frames_of(const Scene& scene, Split split) {
  std::vector<std::size_t> indices;
  for (std::size_t i = 0; i < scene.frames.size(); ++i) {
    if (scene.frames[i].split == split) indices.push_back(i);
  }
  return indices;
}

void apply_holdout(Scene& scene, int n) {
  if (n < 2) {
    throw Error(Fault::usage, text("--holdout ", n, " leaves no image to train on: want 2 or more (8 is usual)"));
  }
  if (scene.is_log) {
    const auto split = [&](int step) { return step % n == 0 ? Split::test : Split::train; };
    for (Frame& frame : scene.frames) frame.split = split(frame.step);
    for (Sweep& sweep : scene.sweeps) sweep.split = split(sweep.step);
    return;
  }
  std::vector<std::size_t> order(scene.frames.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return scene.frames[a].image < scene.frames[b].image; });
  for (std::size_t rank = 0; rank < order.size(); ++rank) {
    scene.frames[order[rank]].split = rank % n == 0 ? Split::test : Split::train;
  }
}

int find_or_add(std::vector<Camera>& cameras, const Camera& camera) {
  const auto found = std::find(cameras.begin(), cameras.end(), camera);
  if (found != cameras.end()) return static_cast<int>(found - cameras.begin());
  cameras.push_back(camera);
  return static_cast<int>(cameras.size()) - 1;
}

}  // namespace cloam
