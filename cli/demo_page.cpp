// See demo_page.h.
#include "cli/demo_page.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <nlohmann/json.hpp>

#include "cli/common.h"
#include "cli/page.h"
#include "cli/report_page.h"
#include "models/io/commit.h"
#include "models/io/image.h"
#include "runtime/error.h"

namespace cloam {
namespace {

using Report = nlohmann::ordered_json;

constexpr char kDemoTitle[] = "cloam: streets, reconstructed and with new vehicles";
constexpr std::size_t kFramesShown = 4;
constexpr int kSecondsBetween = 4;  // that a browser waits before it reads the page again

/// Near is bright; black where there is nothing. Returns the picture's file, beside the render's EXR and PNG.
fs::path depth_picture(const fs::path& exr) {
  constexpr float kHalf = 10;  // metres at which half the brightness is left
  const ImageSize size = read_image_size(fs::path(exr).replace_extension(".png"));
  Image image{size.width, size.height, 1, {}};
  for (const float depth : read_exr_layer(exr, "depth.Z"))
    image.pixels.push_back(depth > 0 ? static_cast<std::uint8_t>(std::lround(255 / (1 + depth / kHalf)))
                                     : std::uint8_t{0});
  fs::path file = exr;
  file.replace_extension(".depth.png");
  write_png(file, image);
  return file;
}

struct MeasuredFigure {
  std::string what, here, other, wanted;
};

std::string decibels(const Report& json, const char* key) {
  return json.at(key).is_number() ? fmt::format("{:.2f} dB", json.at(key).get<double>()) : "-";
}

std::vector<MeasuredFigure> figures_of(const DemoRecord& r) {
  const double samples = frechet_of(r.samples), random = frechet_of(r.random);
  const Report& metres = r.street.at("lidar_median_error_m");
  return {
      {"Held-out images, PSNR", decibels(r.street, "psnr"),
       decibels(r.street, "baseline_blend_psnr") + " (blend of the images before and after)", "22 dB or more"},
      {"Actors in them, PSNR", decibels(r.street, "masked_psnr"),
       decibels(r.street, "baseline_blend_masked_psnr") + " (the same)", ""},
      {"LiDAR depth, median error", metres.is_number() ? fmt::format("{:.2f} m", metres.get<double>()) : "-", "", ""},
      {"Held-out codes, v-loss", fmt::format("{:.3f}", r.prior.at("v_loss").get<double>()),
       fmt::format("{:.3f} (Wiener denoiser), {:.3f} (predicting zero)", r.prior.at("wiener_v_loss").get<double>(),
                   r.prior.at("baseline_zero_v_loss").get<double>()),
       ""},
      {text("Feature distance of new assets to the training assets (",
            r.samples.at("feature_network").get<std::string>(), ")"),
       fmt::format("{:.4g}", samples),
       fmt::format("{:.4g} (codes drawn from a Gaussian of each class), {:.4g} (random latents)",
                   frechet_of(r.gaussian), random),
       fmt::format("half as far as random latents; got {:+.0f} %", 100 * (samples / random - 1))}};
}

std::string table(const std::vector<MeasuredFigure>& figures) {
  std::string out = "<table><tr><th></th><th>here</th><th>baseline</th><th>target</th></tr>\n";
  for (const MeasuredFigure& f : figures)
    out += fmt::format("<tr><td>{}</td><td class=\"number\"><b>{}</b></td><td>{}</td><td>{}</td></tr>\n",
                       escaped(f.what), escaped(f.here), escaped(f.other), escaped(f.wanted));
  return out + "</table>\n";
}

/// A folder of folders of assets, one for each kind.
std::string turntables(const fs::path& folder) {
  std::vector<fs::path> kinds;
  for (const fs::directory_entry& kind : fs::directory_iterator(folder)) kinds.push_back(kind.path());
  std::sort(kinds.begin(), kinds.end());
  std::string figures;
  for (const fs::path& kind : kinds)
    for (const fs::path& turntable : files_in(kind, "asset_", ".gif"))
      figures += figure(turntable, kind.filename().string(), 170);
  return row_of(figures);
}

/// Nothing where the program came without a prior.
std::string first(const DemoFolders& folders) {
  if (!fs::exists(folders.first())) return "";
  return "<h2>New vehicles, from all sides</h2>\n<p>Sampled from the prior that comes with the program. It learned "
         "from made logs for hours; what follows learns for minutes.</p>\n" +
         turntables(folders.first());
}

/// What one part of the page shows; nothing where its files are not there yet.
std::string so_far(const std::function<std::string()>& section) {
  try {
    return section();
  } catch (const std::exception&) { return ""; }
}

std::string list_of(const DemoProgress& progress) {
  std::string out = "<ol>\n";
  for (std::size_t i = 0; i < progress.parts.size(); ++i) {
    const std::string words = escaped(progress.parts[i]);
    const char* now = progress.is_over ? "stopped here" : "being made now";
    out += i < progress.now    ? "<li>" + words + " &#10003;</li>\n"
           : i == progress.now ? "<li><b>" + words + "</b>: " + now + "</li>\n"
                               : "<li>" + words + "</li>\n";
  }
  return out + "</ol>\n";
}

std::string photos_of_logs(const fs::path& logs) {
  std::string figures;
  for (const fs::path& log : files_in(logs, "", "")) {
    const std::vector<fs::path> photos = files_in(log / "camera" / "front_camera", "", ".jpg");
    if (!photos.empty()) figures += figure(photos.front(), log.filename().string(), 280);
  }
  return "<h2>The streets, as their cameras see them</h2>\n" + row_of(figures);
}

std::string newest_of(const fs::path& run, const std::string& title, const std::string& caption) {
  const fs::path picture = main_picture(run);
  return picture.empty() ? "" : "<h2>" + title + "</h2>\n" + figure(picture, caption, 1100);
}

std::string first_grid(const DemoFolders& folders) {
  return "<h2>New assets, of the diffusion model that learned for minutes</h2>\n" +
         figure(folders.samples() / "grid.png", "generated", 380);
}

std::string streets(const DemoRecord& r) {
  std::string out =
      "<h2>Streets, reconstructed</h2>\n<p>Held-out images: reconstruction, photo, error (four times as bright) "
      "and depth (near is bright).</p>\n";
  for (const fs::directory_entry& log : fs::directory_iterator(r.folders.logs())) {
    const std::string name = log.path().filename().string();
    const std::vector<fs::path> depths = files_in(r.folders.before(), name + "_camera_front_camera_", ".exr");
    if (depths.empty()) continue;
    const fs::path& exr = depths.back();
    const fs::path sheet = r.folders.street() / "eval" / "images" / exr.filename().replace_extension(".png");
    out += row_of(figure(sheet, exr.stem().string(), 840) + figure(depth_picture(exr), "depth", 280));
  }
  return out;
}

std::string sets(const DemoRecord& r) {
  return "<h2>What the diffusion model learned</h2>\n<p>Assets of the reconstructed streets, new ones sampled from "
         "the diffusion model, codes drawn from a Gaussian of each class, and random codes.</p>\n" +
         row_of(figure(r.folders.training() / "grid.png", "training assets", 380) +
                figure(r.folders.samples() / "grid.png", "generated", 380) +
                figure(r.folders.gaussian() / "grid.png", "Gaussian codes", 380) +
                figure(r.folders.random() / "grid.png", "random latents", 380));
}

std::string assets(const DemoRecord& r) {
  return "<h2>New vehicles, by class and time of day</h2>\n" + turntables(r.folders.assets());
}

std::string swap(const DemoRecord& r) {
  std::string out = fmt::format(
      "<h2>Before and after</h2>\n<p>Street {} as reconstructed, and the same frames with {} of its vehicles "
      "replaced with generated ones.</p>\n",
      escaped(r.swapped_log), r.swapped.size());
  const std::vector<fs::path> after = files_in(r.folders.after(), "", ".png");
  for (std::size_t i = 0; i < std::min(after.size(), kFramesShown); ++i)
    out += row_of(figure(r.folders.before() / (r.swapped_log + "_" + after[i].filename().string()), "before", 560) +
                  figure(after[i], "after", 560));
  return out;
}

std::string commands(const DemoRecord& r) {
  std::string lines;
  double all = 0;
  for (const DemoCommand& command : r.commands) {
    lines += fmt::format("{}   # {:.1f} s\n", escaped(command.line), command.seconds);
    all += command.seconds;
  }
  return fmt::format("<h2>How to reproduce it</h2>\n<p>These commands were run; they took {}.</p>\n<pre>{}</pre>\n",
                     words_for_seconds(all), lines);
}

}  // namespace

double frechet_of(const Report& distance) {
  return distance.at(distance.contains("fid") ? "fid" : "frechet_feature_distance").get<double>();
}

void write_progress_page(const DemoProgress& progress) {
  const DemoFolders& f = progress.folders;
  std::string body = "<p>This page fills while the demo goes on, and shows itself anew every few seconds.</p>\n";
  if (progress.is_over) body = "<p>The demo ended early; this is what was finished.</p>\n";
  body += list_of(progress);
  body += so_far([&] { return first(f); });
  body += so_far([&] {
    return newest_of(f.street(), "The reconstruction so far", "reconstruction, photo and error of one held-out image");
  });
  body += so_far([&] { return photos_of_logs(f.logs()); });
  body += so_far([&] { return first_grid(f); });
  body += so_far([&] { return "<h2>New vehicles, by class and time of day</h2>\n" + turntables(f.assets()); });
  commit_text(f.page(), html_page(kDemoTitle, body, progress.is_over ? 0 : kSecondsBetween));
}

GrowingPage::GrowingPage(DemoProgress progress)
    : progress_(std::move(progress)), writer_([this](const std::stop_token& stop) { keep_writing(stop); }) {}

GrowingPage::~GrowingPage() {
  if (!writer_.joinable()) return;
  end();
  progress_.is_over = true;
  write();
}

void GrowingPage::end() {
  writer_.request_stop();
  writer_.join();
}

void GrowingPage::keep_writing(const std::stop_token& stop) {
  std::mutex unused;
  std::condition_variable_any asked_to_stop;
  std::unique_lock lock(unused);
  do write();
  while (!asked_to_stop.wait_for(lock, stop, std::chrono::seconds(kSecondsBetween),
                                 [&] { return stop.stop_requested(); }));
}

/// The page so far is no part of what the demo makes: where the disk is full, the demo itself says so.
void GrowingPage::write() noexcept {
  try {
    progress_.now = now_;
    write_progress_page(progress_);
  } catch (const std::exception&) {}
}

void write_demo_page(const DemoRecord& r) {
  const std::string body =
      first(r.folders) + table(figures_of(r)) + streets(r) + sets(r) + assets(r) + swap(r) + commands(r);
  commit_text(r.folders.page(), html_page(kDemoTitle, body));
}

}  // namespace cloam
