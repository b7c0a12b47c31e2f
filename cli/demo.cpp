// cloam demo: a scene that it makes itself, trained, measured and rendered. No data, no network, no GPU needed.
#include <algorithm>
#include <filesystem>

#include "cli/commands.h"
#include "cli/eval.h"
#include "cli/render.h"
#include "cli/train.h"
#include "models/data/synthetic_scene.h"
#include "models/io/image.h"
#include "models/train/pictures.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr int kOrbitFrames = 36, kSheetColumns = 3;
constexpr char kExamples[] = R"(Make a scene, train on it for a minute, and show pictures.

Examples:
  cloam demo
  cloam demo -o showcase --time-budget 2m)";

struct DemoRequest {
  std::string out = "demo", time_budget = "60s";
  int size = 128;
};

std::vector<fs::path> pngs_in(const fs::path& folder) {
  std::vector<fs::path> found;
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (entry.path().extension() == ".png") found.push_back(entry.path());
  }
  std::sort(found.begin(), found.end());
  return found;
}

void write_sheet(const fs::path& path, const fs::path& pictures) {
  std::vector<Image> images;
  for (const fs::path& picture : pngs_in(pictures)) images.push_back(read_image(picture));
  if (!images.empty()) write_png(path, contact_sheet(images, kSheetColumns));
}

int train_demo(const DemoRequest& request, const fs::path& data, const fs::path& run, const Common& common) {
  TrainRequest train;
  train.method = "nerf";
  train.data = {data.string()};
  train.out = run.string();
  train.time_budget = request.time_budget;
  train.overwrite = true;
  train.seconds_before = seconds_since_start();
  return run_train(train, common);
}

int run_command(const DemoRequest& request, const Common& common) {
  open_device(common);
  const fs::path out = request.out, data = out / "data", run = out / "run", orbit = out / "orbit";
  say(common, "making a scene of 40 views in " + data.string());
  write_synthetic_scene(data, {.size = request.size});
  const int code = train_demo(request, data, run, common);
  if (code != 0) return code;  // interrupted; all is saved and said
  Common talk = common;
  talk.quiet = true;
  EvalRequest eval;
  eval.run = run.string();
  run_eval(eval, common.json ? common : talk);
  say(common, "rendering a turntable");
  RenderRequest render;
  render.run = run.string();
  render.out = orbit.string();
  render.path = "orbit";
  render.frames = kOrbitFrames;
  talk.json = false;
  run_render(render, talk);
  const fs::path sheet = out / "views.png", turntable = out / "turntable.gif";
  write_sheet(sheet, run / "eval" / "images");
  fs::copy_file(orbit / "orbit.gif", turntable, fs::copy_options::overwrite_existing);
  say(common,
      text("\npictures:\n  ", sheet.string(), "  render | truth | error, held-out views\n  ", turntable.string(),
           "  once around\nnext: cloam train nerf YOUR-DATA -o runs/first   (cloam check YOUR-DATA first)"));
  return 0;
}

}  // namespace

Command add_demo(CLI::App& program) {
  CLI::App* parser = program.add_subcommand("demo", kExamples);
  const auto request = std::make_shared<DemoRequest>();
  const auto common = std::make_shared<Common>();
  parser->add_option("-o,--out", request->out, "Folder for everything it makes (demo)");
  parser->add_option("--time-budget", request->time_budget, "Of the training (60s)");
  parser->add_option("--size", request->size, "Side of the pictures in pixels (128)")->check(CLI::Range(16, 1024));
  add_common(*parser, *common);
  return {parser, [=] { return run_command(*request, *common); }};
}

}  // namespace cloam
