// See small_street.h.
#include "tests/cli/small_street.h"

#include <doctest/doctest.h>

#include "tests/cli/process.h"

namespace cloam {
namespace fs = std::filesystem;

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
    const Outcome trained = cloam_with(words);
    REQUIRE_MESSAGE(trained.code == 0, trained.err);
    return folder;
  }();
  return run;
}

}  // namespace cloam
