// cloam check: is this folder a capture that can be trained? Every image is read, none is kept.
#include <nlohmann/json.hpp>

#include "cli/capture.h"
#include "cli/commands.h"
#include "models/data/read_scene.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr char kExamples[] = R"(Check a capture and show what a training would take from it.

Examples:
  cloam check data/fox
  cloam check data/fox --downscale 4 --holdout 8
  cloam check data/fox --json)";

struct CheckRequest {
  std::string data;
  int downscale = 1, holdout = 0;
  bool skip_bad = false;
};

/// One image in memory at a time. Returns what is odd, each kind of remark once.
std::vector<std::string> check_images(const Scene& scene, const RunData& how) {
  std::vector<std::string> warnings;
  Scene single = scene;
  int resized = 0;
  for (const Frame& frame : scene.frames) {
    single.frames = {frame};
    const Pixels pixels = load_images(single, frame.split, {how.downscale, how.skip_bad});
    if (pixels.frames.empty())
      warnings.insert(warnings.end(), pixels.warnings.begin(), pixels.warnings.end());
    else if (!pixels.warnings.empty() && resized++ == 0)
      warnings.push_back(pixels.warnings.front());
  }
  if (resized > 1) warnings.push_back(text("... and ", resized - 1, " more images of another size"));
  return warnings;
}

int run_command(const CheckRequest& request, const Common& common) {
  RunData how;
  how.downscale = request.downscale;
  how.holdout = request.holdout;
  how.skip_bad = request.skip_bad;
  const Scene scene = read_split_scene(request.data, how);
  std::vector<std::string> warnings = scene.warnings;
  for (const auto& more : {check_images(scene, how), check_scene(scene)}) {
    warnings.insert(warnings.end(), more.begin(), more.end());
  }
  for (const std::string& warning : warnings) warn(warning);
  const uint64_t bytes = image_bytes(scene, Split::train, how.downscale);
  if (common.json) {
    const nlohmann::ordered_json json = {{"schema_version", 1},
                                         {"format", scene.format},
                                         {"images_listed", scene.frames_listed},
                                         {"images", scene.frames.size()},
                                         {"images_train", frames_of(scene, Split::train).size()},
                                         {"images_test", frames_of(scene, Split::test).size()},
                                         {"cameras", scene.cameras.size()},
                                         {"has_alpha", scene.has_alpha},
                                         {"image_bytes", bytes},
                                         {"warnings", warnings}};
    put(json.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n");
    return 0;
  }
  std::string out;
  for (const std::string& line : describe(scene, how)) out += line + "\n";
  put(out + "training images in memory: " + words_for_bytes(bytes) + "\n");
  say(common, "ok. next: cloam train nerf " + quoted(request.data));
  return 0;
}

}  // namespace

Command add_check(CLI::App& program) {
  CLI::App* parser = program.add_subcommand("check", kExamples);
  const auto request = std::make_shared<CheckRequest>();
  const auto common = std::make_shared<Common>();
  parser->add_option("DATA", request->data, "Folder of the capture")->required();
  parser->add_option("--downscale", request->downscale, "As in train")->check(CLI::Range(1, 256));
  parser->add_option("--holdout", request->holdout, "As in train")->check(CLI::Range(2, 1 << 20));
  parser->add_flag("--skip-bad", request->skip_bad, "Warn of damaged images instead of stopping");
  add_common(*parser, *common);
  return {parser, [=] { return run_command(*request, *common); }};
}

}  // namespace cloam
