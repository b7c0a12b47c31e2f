// See small_street.h.
#include "tests/cli/small_street.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cstring>

#include "models/io/safetensors.h"

namespace cloam {
namespace fs = std::filesystem;

void give_surfaces(const fs::path& checkpoint) {
  SafetensorsFile file = read_safetensors(checkpoint);
  const float distance = -1;  // the bias of the first of the numbers that texels add to
  std::memcpy(file.tensors.at("param.networks.field.past.bias").data.data(), &distance, sizeof distance);
  write_safetensors(checkpoint, file);
}

const fs::path& small_street() {
  static const fs::path log = [] {
    const Outcome made = cloam_with({"synth", "-o", (scratch() / "street").string(), "--logs", "1", "--frames", "3",
                                     "--size", "48x27", "--cameras", "front", "--beams", "24", "-q"});
    REQUIRE_MESSAGE(made.code == 0, made.err);
    return scratch() / "street" / "001";
  }();
  return log;
}

const fs::path& small_street_run() {
  static const fs::path run = [] {
    const fs::path folder = scratch() / "street_run";
    Words words = {"train",
                   "genassets",
                   small_street().string(),
                   "-o",
                   folder.string(),
                   "--preset",
                   "genassets-small",
                   "--steps",
                   "1",
                   "--holdout",
                   "3",
                   "-q"};
    for (const char* setting : {"background.side=32", "batch.patches=1", "batch.patch_side=8", "batch.lidar_rays=32",
                                "code.side=4", "weight.perceptual=0"}) {
      words.insert(words.end(), {"--set", setting});
    }
    const Outcome trained = cloam_with(without_pictures(words));
    REQUIRE_MESSAGE(trained.code == 0, trained.err);
    return folder;
  }();
  return run;
}

const fs::path& two_streets_run() {
  static const fs::path run = [] {
    const std::string logs = (scratch() / "two_streets").string(), folder = (scratch() / "two_streets_run").string();
    const Outcome made = cloam_with({"synth", "-o", logs, "--logs", "2", "--frames", "3", "--size", "48x27",
                                     "--cameras", "front", "--beams", "24", "--night", "0.5", "-q"});
    REQUIRE_MESSAGE(made.code == 0, made.err);
    Words words = {"train",    "genassets",       logs + "/001", logs + "/002", "-o", folder,
                   "--preset", "genassets-small", "--steps",     "8",           "-q"};
    for (const char* setting :
         {"background.side=32", "batch.patches=2", "batch.patch_side=8", "batch.lidar_rays=32", "code.side=4",
          "code.channels=4", "decoder.middle=16", "decoder.widths=16,8,8", "decoder.groups=4", "weight.perceptual=0",
          "prior.guidance=0.5", "weight.silhouette=0.01"})
      words.insert(words.end(), {"--set", setting});
    const Outcome trained = cloam_with(without_pictures(words));
    REQUIRE_MESSAGE(trained.code == 0, trained.err);
    give_surfaces(fs::path(folder) / "ckpt" / "000008.safetensors");
    return fs::path(folder);
  }();
  return run;
}

Words small_diffusion(const fs::path& source, const fs::path& run, const Words& more) {
  Words words = {"train", "diffusion", source.string(), "-o", run.string(), "--preset", "diffusion-small", "-q"};
  for (const char* setting : {"unet.base=8", "unet.groups=4", "batch.codes=8"})
    words.insert(words.end(), {"--set", setting});
  words.insert(words.end(), more.begin(), more.end());
  return without_pictures(words);
}

const fs::path& small_diffusion_run() {
  static const fs::path run = [] {
    const fs::path folder = scratch() / "assets";
    const Outcome trained = cloam_with(small_diffusion(two_streets_run(), folder, kDiffusionSteps));
    REQUIRE_MESSAGE(trained.code == 0, trained.err);
    return folder;
  }();
  return run;
}

}  // namespace cloam
