// cloam eval: PSNR and SSIM on photos that were held out, beside what trivial guesses score.
#include "cli/eval.h"

#include <chrono>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>

#include "cli/capture.h"
#include "cli/commands.h"
#include "models/io/commit.h"
#include "models/io/image.h"
#include "models/train/evaluate.h"
#include "models/train/pictures.h"
#include "models/train/restore_run.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;
using Report = nlohmann::ordered_json;

constexpr char kExamples[] = R"(Measure a run on photos that it was not trained on.

Examples:
  cloam eval runs/fox
  cloam eval runs/fox --json
  cloam eval runs/fox --data data/fox-evening --images pictures)";

struct Photos {
  std::string protocol;
  Scene scene, train_scene;
  Pixels measured, train;
};

Pixels all_images(const Scene& scene, const LoadOptions& options) {
  Pixels all = load_images(scene, Split::train, options);
  Pixels more = load_images(scene, Split::test, options);
  for (FramePixels& frame : more.frames) {
    frame.camera = find_or_add(all.cameras, more.cameras[static_cast<std::size_t>(frame.camera)]);
    all.frames.push_back(std::move(frame));
  }
  return all;
}

/// The run's own photos: its held-out images, else those it was trained on.
Photos own_photos(const RestoredRun& run, const fs::path& folder) {
  const Reading& how = run.record.reading;
  const LoadOptions options{how.downscale, how.skip_bad};
  Photos photos;
  photos.scene = read_split_scene(find_data(folder, run.record.data.front()), how);
  if (fingerprint(photos.scene) != run.record.data.front().fingerprint)
    warn("the data differs from what the run was trained on");
  photos.train_scene = photos.scene;
  photos.train = load_images(photos.scene, Split::train, options);
  photos.measured = load_images(photos.scene, Split::test, options);
  photos.protocol = how.holdout > 0 ? text("holdout-", how.holdout) : "test-split";
  if (!photos.measured.frames.empty()) return photos;
  photos.measured = photos.train;
  photos.protocol = "train-images";
  warn("no image was held out: these are the training photos (train with --holdout 8 for a fair figure)");
  return photos;
}

/// Photos of another folder in the same coordinates; the guesses are still made from the run's own.
Photos other_photos(const RestoredRun& run, const EvalRequest& request) {
  Reading how = run.record.reading;
  how.holdout = 0;
  const LoadOptions options{how.downscale, how.skip_bad};
  Photos photos;
  photos.scene = read_split_scene(request.other, how);
  photos.measured = load_images(photos.scene, Split::test, options);
  photos.protocol = photos.measured.frames.empty() ? "all-images" : "test-split";
  if (photos.measured.frames.empty()) photos.measured = all_images(photos.scene, options);
  try {
    photos.train_scene = read_split_scene(find_data(request.run, run.record.data.front()), run.record.reading);
    photos.train = load_images(photos.train_scene, Split::train, options);
  } catch (const Error& error) {
    warn(text("no baselines: ", error.what()));
    photos.train_scene = photos.scene;
    photos.train = {};
  }
  return photos;
}

/// JSON has no infinity (equal images) and no NaN.
Report finite(double value) { return std::isfinite(value) ? Report(value) : Report(nullptr); }
Report finite(const std::optional<double>& value) { return value ? finite(*value) : Report(nullptr); }

Report to_json(const Evaluation& result, const Photos& photos, const RestoredRun& run, double seconds) {
  Report json = {{"schema_version", 1},
                 {"protocol", photos.protocol},
                 {"images", result.images.size()},
                 {"psnr", finite(result.psnr)},
                 {"ssim", finite(result.ssim)}};
  if (result.masked) json["psnr_full"] = finite(result.psnr_full);
  json["baseline_mean_colour_psnr"] = finite(result.baseline_mean_colour_psnr);
  json["baseline_nearest_frame_psnr"] = finite(result.baseline_nearest_frame_psnr);
  json["method"] = run.record.method;
  json["preset"] = run.record.preset;
  json["step"] = run.progress.step;
  json["downscale"] = run.record.reading.downscale;
  json["seconds"] = seconds;
  return json;
}

std::string csv_word(const std::string& word) {
  std::string out = "\"";
  for (const char c : word) out += c == '"' ? std::string("\"\"") : std::string(1, c);
  return out + "\"";
}

void write_reports(const fs::path& folder, Report json, const Evaluation& result) {
  std::string csv = "image,psnr,ssim,psnr_full\n";
  json["per_image"] = Report::array();
  for (const ImageScore& image : result.images) {
    csv += text(csv_word(image.name), ",", image.psnr, ",", image.ssim, ",", image.psnr_full, "\n");
    json["per_image"].push_back({{"image", image.name},
                                 {"psnr", finite(image.psnr)},
                                 {"ssim", finite(image.ssim)},
                                 {"psnr_full", finite(image.psnr_full)}});
  }
  commit_text(folder / "per_image.csv", csv);
  commit_text(folder / "eval.json", json.dump(2, ' ', false, Report::error_handler_t::replace) + "\n");
}

std::string row(const std::string& name, const std::optional<double>& psnr, const std::optional<double>& similarity) {
  char buffer[160];
  std::snprintf(buffer, sizeof buffer, "%-38.38s", name.c_str());
  std::string line = buffer;
  std::snprintf(buffer, sizeof buffer, "  %7.2f", psnr.value_or(NAN));
  line += psnr ? buffer : "        -";
  std::snprintf(buffer, sizeof buffer, "  %7.4f", similarity.value_or(NAN));
  return line + (similarity ? buffer : "") + "\n";
}

std::string table(const Evaluation& result, const Photos& photos, const RestoredRun& run) {
  std::string out =
      text("protocol ", photos.protocol, ", ", result.images.size(), " images, step ", run.progress.step, "\n");
  char head[80];
  std::snprintf(head, sizeof head, "%-38s  %7s  %7s\n", "image", "PSNR", "SSIM");
  out += head;
  for (const ImageScore& image : result.images) out += row(image.name, image.psnr, image.ssim);
  out += row("mean", result.psnr, result.ssim);
  if (result.masked) out += row("mean over all pixels, masked ones too", result.psnr_full, std::nullopt);
  out += row("baseline: mean colour of training", result.baseline_mean_colour_psnr, std::nullopt);
  return out + row("baseline: nearest training photo", result.baseline_nearest_frame_psnr, std::nullopt);
}

Evaluation measure(const RestoredRun& run, const Photos& photos, const fs::path& pictures, const Common& common) {
  std::vector<std::size_t> frames;
  for (const FramePixels& frame : photos.measured.frames) frames.push_back(frame.frame);
  const std::vector<std::string> names = file_names(photos.scene, frames);
  std::size_t done = 0;
  return evaluate(
      *run.method, {photos.scene, photos.measured, photos.train_scene, photos.train}, [&](const EvaluatedImage& image) {
        const int w = image.frame.width, h = image.frame.height;
        const auto& rgb = image.picture.rgb;
        write_png(
            pictures / (names[done++] + ".png"),
            contact_sheet({to_image(rgb, w, h), to_image(image.truth, w, h), error_image(rgb, image.truth, w, h)}, 3));
        say(common, text("eval ", done, "/", names.size(), "  ", image.score.name));
      });
}

}  // namespace

int run_eval(const EvalRequest& request, const Common& common) {
  const auto start = std::chrono::steady_clock::now();
  read_record(request.run);  // a wrong folder is told before a missing device
  open_device(common);
  const RestoredRun run = restore_run(request.run);
  if (!run.checkpoint.warning.empty()) warn(run.checkpoint.warning);
  const Photos photos = request.other.empty() ? own_photos(run, request.run) : other_photos(run, request);
  for (const std::string& warning : photos.measured.warnings) warn(warning);
  const fs::path folder = RunPaths{request.run}.eval();
  const fs::path pictures = request.images.empty() ? folder / "images" : fs::path(request.images);
  const Evaluation result = measure(run, photos, pictures, common);
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  const Report json = to_json(result, photos, run, seconds);
  write_reports(folder, json, result);
  if (common.json)
    put(json.dump(2, ' ', false, Report::error_handler_t::replace) + "\n");
  else
    put(table(result, photos, run));
  say(common, text("pictures ", pictures.string(), "  (render | photo | error x4)"));
  return 0;
}

Command add_eval(CLI::App& program) {
  CLI::App* parser = program.add_subcommand("eval", kExamples);
  const auto request = std::make_shared<EvalRequest>();
  const auto common = std::make_shared<Common>();
  parser->add_option("RUN", request->run, "Run folder")->required();
  parser->add_option("--data", request->other, "Other photos in the same coordinates: their test split, else all");
  parser->add_option("--images", request->images, "Folder for the pictures (default RUN/eval/images)");
  add_common(*parser, *common);
  return {parser, [=] { return run_eval(*request, *common); }};
}

}  // namespace cloam
