// Mixed precision, through the program.
#include <doctest/doctest.h>

#include <algorithm>
#include <cstring>

#include "models/io/safetensors.h"
#include "tests/cli/small_street.h"
#include "tests/cli/small_trainings.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

const SmallTraining& training_of(const std::string& method) {
  return *std::ranges::find_if(small_trainings(), [&](const SmallTraining& one) { return method == one.method; });
}

/// Four steps, a checkpoint after the second.
Words steps_with(const Words& more) {
  Words words = {"--steps", "4", "--save-every", "2"};
  words.insert(words.end(), more.begin(), more.end());
  return words;
}

std::string last_checkpoint(const fs::path& run) { return content_of(run / "ckpt" / "000004.safetensors"); }

/// The image decoder's first convolution gives numbers beyond those of half precision.
void enlarge_decoder(const fs::path& checkpoint) {
  SafetensorsFile file = read_safetensors(checkpoint);
  std::vector<std::byte>& bytes = file.tensors.at("param.networks.image.enter.bias").data;
  const float beyond = 1e5f;
  for (std::size_t at = 0; at < bytes.size(); at += sizeof beyond) std::memcpy(&bytes[at], &beyond, sizeof beyond);
  write_safetensors(checkpoint, file);
}

}  // namespace

TEST_CASE("mixed precision is recorded, and a run that is resumed keeps it") {
  for (const std::string method : {"genassets", "diffusion"}) {
    CAPTURE(method);
    const auto trained = [&](const std::string& name, const Words& more) {
      const fs::path run = scratch() / (method + name);
      const Outcome outcome = cloam_with(training_of(method).words(run, steps_with(more)));
      REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
      return run;
    };
    const fs::path full = trained("_full", {"--precision", "full"});
    const fs::path whole = trained("_mixed", {"--precision", "mixed"});
    CHECK(last_checkpoint(whole) != last_checkpoint(full));
    CHECK(json_of(full / "run.json")["settings"]["precision.mixed"] == "false");
    CHECK(json_of(whole / "run.json")["settings"]["precision.mixed"] == "true");
    CHECK(contains(cloam_with({"config", "show", whole.string()}).out, "precision.mixed = true  # --precision: "));
    const fs::path parts = trained("_mixed_in_parts", {"--precision", "mixed", "--stop-after", "2"});
    const Outcome other = cloam_with({"train", "--resume", parts.string(), "--precision", "full"});
    CHECK(other.code == 2);
    CHECK_MESSAGE(contains(other.err, "--precision full differs from the run, which has mixed"), other.err);
    const Outcome resumed = cloam_with({"train", "--resume", parts.string(), "--pictures", "off"});
    CHECK_MESSAGE(resumed.code == 0, resumed.err);
    CHECK(contains(resumed.err, ", mixed precision, "));
    CHECK(last_checkpoint(parts) == last_checkpoint(whole));
    // Nothing but the option decides: without it precision is full.
    const std::string file = (whole / "config.toml").string();
    CHECK(last_checkpoint(trained("_by_file", {"--config", file})) == last_checkpoint(full));
    const Outcome set = cloam_with(training_of(method).words(scratch() / "never", {"--set", "precision.mixed=true"}));
    CHECK(set.code == 2);
    CHECK_MESSAGE(contains(set.err, "follows from --precision alone"), set.err);
  }
}

TEST_CASE("numbers beyond half precision end the training with the way out; in full precision it goes on") {
  for (const std::string precision : {"full", "mixed"}) {
    CAPTURE(precision);
    const fs::path run = scratch() / ("beyond_half_" + precision);
    const Words how = steps_with({"--precision", precision, "--stop-after", "2"});
    REQUIRE(cloam_with(training_of("genassets").words(run, how)).code == 0);
    enlarge_decoder(run / "ckpt" / "000002.safetensors");
    const Outcome resumed = cloam_with({"train", "--resume", run.string(), "--pictures", "off"});
    CAPTURE(resumed.err);
    CHECK(resumed.code == (precision == "full" ? 0 : 6));
    CHECK(contains(resumed.err, "numbers of 16 bits end at 65504") == (precision == "mixed"));
    CHECK(contains(resumed.err, "train anew with --precision full") == (precision == "mixed"));
  }
}

}  // namespace cloam
