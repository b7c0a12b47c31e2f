// See preview.h.
#include "cli/preview.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "cli/page.h"
#include "models/eval/evaluate.h"
#include "models/eval/pictures.h"
#include "models/io/words.h"
#include "models/runs/run_folder.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr double kFirstAfter = 10, kLeastBetween = 15;  // seconds
constexpr double kShare = 0.02;                         // of the time, at most
constexpr double kPartOfCourse = 0.02;                  // of a long training passes between two
constexpr int kProbe = 4;                               // of a preview's sides, to tell what it takes
constexpr std::size_t kMostKept = 100;

/// The same photo and view with so many pixels.
void shrink(PreviewFrame& frame, int width, int height) {
  FramePixels& photo = frame.photo;
  photo.rgba = resized({photo.width, photo.height, 4, photo.rgba}, width, height).pixels;
  if (!photo.mask.empty()) {
    photo.mask = resized({photo.width, photo.height, 1, photo.mask}, width, height).pixels;
    for (std::uint8_t& used : photo.mask) used = used == 255 ? 255 : 0;  // ignored if any of its pixels is
  }
  photo.width = width;
  photo.height = height;
  frame.view.camera = resized(frame.view.camera, width, height);
}

int64_t step_of(const fs::path& preview) {
  const std::string name = preview.stem().string();
  return number_in<int64_t>(std::string_view(name).substr(name.find('_') + 1)).value_or(0);
}

/// Of those between the first and the last, those whose neighbours are nearest go.
void thin_out(const fs::path& folder) {
  std::vector<fs::path> files = files_in(folder, "step_", ".png");
  std::sort(files.begin(), files.end(), [](const fs::path& a, const fs::path& b) { return step_of(a) < step_of(b); });
  while (files.size() > kMostKept) {
    std::size_t least = 1;
    const auto gap = [&](std::size_t i) { return step_of(files[i + 1]) - step_of(files[i - 1]); };
    for (std::size_t i = 1; i + 1 < files.size(); ++i)
      if (gap(i) < gap(least)) least = i;
    std::error_code error;
    fs::remove(files[least], error);
    files.erase(files.begin() + static_cast<std::ptrdiff_t>(least));
  }
}

}  // namespace

PreviewWish preview_wish(const std::string& word) {
  if (word == "auto") return {};
  if (word == "off") return {true, 0, 0};
  if (const auto steps = number_in<int64_t>(word); steps && *steps > 0) return {false, *steps, 0};
  const std::string wanted =
      text("--preview-every ", word, ": want a number of steps, a time such as 30s or 5m, auto or off");
  if (word.empty() || !std::isalpha(static_cast<unsigned char>(word.back()))) throw Error(Fault::usage, wanted);
  try {
    return {false, 0, parse_duration(word)};
  } catch (const Error&) { throw Error(Fault::usage, wanted); }
}

bool PreviewPace::is_due(int64_t step, double now, std::optional<double> left,
                         const std::function<double()>& cost) const {
  if (wish_.off) return false;
  if (wish_.steps > 0) return step % wish_.steps == 0;
  const double since = now - made_at_;
  if (wish_.seconds > 0) return since >= wish_.seconds && (!left || *left > 2 * cost());
  if (since < (any_ ? std::max(kLeastBetween, now * kPartOfCourse) : kFirstAfter)) return false;
  if (left && *left < 2 * cost()) return false;
  // The first may come early where the time that is left will make up for it.
  const double earned = any_ ? since : now + left.value_or(0);
  return earned >= cost() / kShare || (!any_ && !left);
}

void PreviewPace::made(double now) {
  made_at_ = now;
  any_ = true;
}

PreviewFrame preview_frame(const Captures& captures) {
  const auto held_out = std::find_if(captures.begin(), captures.end(),
                                     [](const Capture& capture) { return !capture.test.frames.empty(); });
  const bool any = held_out != captures.end();
  const Capture& capture = any ? *held_out : captures.front();
  const Pixels& pixels = any ? capture.test : capture.train;
  const FramePixels& photo = pixels.frames.front();
  const Frame& frame = capture.scene.frames[photo.frame];
  PreviewFrame preview{photo,
                       view_of(frame, pixels.cameras[static_cast<std::size_t>(photo.camera)],
                               any ? static_cast<int>(held_out - captures.begin()) : 0),
                       frame.image, any};
  const double scale = static_cast<double>(kLargestPreview) / std::max(photo.width, photo.height);
  const auto side = [&](int pixels_before) {
    return std::max(1, static_cast<int>(std::lround(scale * pixels_before)));
  };
  if (scale < 1) shrink(preview, side(photo.width), side(photo.height));
  return preview;
}

double Previews::cost() {
  if (cost_ > 0) return cost_;
  View few = frame_.view;
  few.camera = resized(few.camera, std::max(1, few.camera.width / kProbe), std::max(1, few.camera.height / kProbe));
  method_.render(few);  // may compile kernels
  const double begun = steady_seconds();
  method_.render(few);
  cost_ = (steady_seconds() - begun) * kProbe * kProbe;
  return cost_;
}

fs::path Previews::make(int64_t step) {
  const double begun = steady_seconds();
  const Picture picture = method_.render(frame_.view);
  const std::vector<float> truth = on_white(frame_.photo);
  const ImageScore score = score_image(picture.rgb, truth, frame_.photo);
  const int w = picture.width, h = picture.height;
  const fs::path folder = RunPaths{run_}.preview(), path = folder / fmt::format("step_{:06}.png", step);
  const std::vector<Caption> captions = {{"render", text("step ", step)},
                                         {frame_.held_out ? "photo, held out" : "photo, trained on", frame_.name},
                                         {"error x4", fmt::format("PSNR {:.2f} dB", score.psnr)}};
  write_png(path,
            contact_sheet({to_image(picture.rgb, w, h), to_image(truth, w, h), error_image(picture.rgb, truth, w, h)},
                          3, captions));
  thin_out(folder);
  log_.write("eval", {{"step", step},
                      {"images", 1},
                      {"psnr", score.psnr},
                      {"ssim", score.ssim},
                      {"picture", path.string()},
                      {"seconds", cost_ = steady_seconds() - begun}});
  return path;
}

}  // namespace cloam
