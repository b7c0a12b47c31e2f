#include "tests/cli/small_trainings.h"

#include "tests/cli/small_street.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

Words with_settings(Words words, const Words& settings, const Words& more) {
  for (const std::string& setting : settings) words.insert(words.end(), {"--set", setting});
  words.insert(words.end(), more.begin(), more.end());
  return without_pictures(words);
}

Words nerf(const fs::path& run, const Words& more) { return small_training(small_scene(), run, more); }

Words splat(const fs::path& run, const Words& more) {
  return with_settings({"train", "splat", small_scene().string(), "-o", run.string(), "--progress", "plain"},
                       {"initial=random", "initial.random=100", "growth.start=1", "growth.every=2"}, more);
}

Words genassets(const fs::path& run, const Words& more) {
  return with_settings({"train", "genassets", small_street().string(), "-o", run.string(), "--preset",
                        "genassets-small", "--progress", "plain"},
                       {"background.side=32", "batch.patches=1", "batch.patch_side=8", "batch.lidar_rays=32",
                        "code.side=4", "weight.perceptual=0"},
                       more);
}

Words street_gaussians(const fs::path& run, const Words& more) {
  return with_settings({"train", "street-gaussians", small_street().string(), "-o", run.string(), "--preset",
                        "street-gaussians-small", "--progress", "plain"},
                       {"initial.lidar=100", "initial.near=20", "initial.far=20", "initial.actor=20",
                        "initial.fewest=20", "sky.side=4", "growth.start=1", "growth.every=2", "batch.depth_every=2"},
                       more);
}

Words neurad(const fs::path& run, const Words& more) {
  return with_settings(
      {"train", "neurad", small_street().string(), "-o", run.string(), "--preset", "neurad-small", "--progress",
       "plain"},
      {"grid.log2_rows=10", "actors.log2_rows=8", "batch.patches=1", "batch.patch_side=8", "batch.lidar_rays=32"},
      more);
}

Words zipnerf(const fs::path& run, const Words& more) {
  return with_settings(
      {"train", "zipnerf", small_scene().string(), "-o", run.string(), "--preset", "zipnerf-small", "--progress",
       "plain"},
      {"grid.log2_rows=10", "proposals.log2_rows=8", "batch.rays=64", "samples.proposal=8", "samples.field=8"}, more);
}

Words diffusion(const fs::path& run, const Words& more) { return small_diffusion(two_streets_run(), run, more); }

}  // namespace

const std::vector<SmallTraining>& small_trainings() {
  static const std::vector<SmallTraining> all = {{"nerf", nerf},
                                                 {"splat", splat},
                                                 {"genassets", genassets},
                                                 {"diffusion", diffusion},
                                                 {"street-gaussians", street_gaussians},
                                                 {"neurad", neurad},
                                                 {"zipnerf", zipnerf}};
  return all;
}

}  // namespace cloam
