// Blending of Gaussian splats, over three decades of pairs of tile and gaussian at one density.
#include "runtime/ops/splat.h"

#include "benchmarks/splat_input.h"
#include "benchmarks/workload.h"
#include "runtime/ops.h"

namespace cloam {
namespace {

struct Scene {
  Splats splats;
  SplatTiles tiles;
};

Scene prepare(int width, int height) {
  const SplatInput in = splat_input(width, height);
  const auto count = static_cast<int64_t>(in.opacities.size()), pairs = static_cast<int64_t>(in.ids.size()),
             offsets = static_cast<int64_t>(in.offsets.size());
  std::vector<float> seen;
  for (size_t i = 0; i < in.opacities.size(); i++) {
    seen.insert(seen.end(), {in.means[2 * i], in.means[2 * i + 1], in.conics[3 * i], in.conics[3 * i + 1],
                             in.conics[3 * i + 2], in.opacities[i], 1.f});
  }
  return {{parameter(seen, {count, 7}), parameter(in.colours, {count, 3})},
          splat_lists(from_host(in.ids, {pairs}), from_host(in.offsets, {offsets}), {count, height, width})};
}

Run forward(int width, int height) {
  const Scene scene = prepare(width, height);
  return [=] {
    const Blended out = splat_blend(scene.splats, scene.tiles);
    eval({out.image, out.transmittance});
  };
}

/// With the gradient of |image|^2 / 2.
Run both_ways(int width, int height) {
  const Scene scene = prepare(width, height);
  return [=] {
    const Splats& s = scene.splats;
    eval(grad(sum(square(splat_blend(s, scene.tiles).image)) * 0.5f, {s.seen, s.colours}));
  };
}

void add(Workloads& all, int width, int height, const std::string& pairs) {
  const std::string name = "splat_blend." + std::to_string(width) + "x" + std::to_string(height) + "." + pairs;
  all.push_back({name + ".fwd", 0, 0, [=] { return forward(width, height); }, {"host"}});
  all.push_back({name + ".fwdbwd", 0, 0, [=] { return both_ways(width, height); }, {}});
}

}  // namespace

void add_splat_workloads(Workloads& all) {
  add(all, 80, 64, "3k");
  add(all, 256, 192, "38k");
  add(all, 800, 608, "400k");
  add(all, 2528, 1920, "4m");
}

}  // namespace cloam
