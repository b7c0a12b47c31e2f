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
constexpr double kShortest = 30;        // seconds: of a training that is shorter a preview may take more
constexpr double kShare = 0.02;         // of the time, at most
constexpr double kShareOfFirst = 0.05;  // of the time that the training will take
constexpr double kPartOfCourse = 0.02;  // of a long training passes between two
constexpr double kProbe = 80;           // pixels of the longer side, to tell what a preview takes
constexpr std::size_t kMostKept = 100;

int scaled_side(int pixels, double scale) { return std::max(1, static_cast<int>(std::lround(scale * pixels))); }

/// The same photo and view with fewer pixels.
void shrink(PreviewFrame& frame, double scale) {
  FramePixels& photo = frame.photo;
  const int width = scaled_side(photo.width, scale), height = scaled_side(photo.height, scale);
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
                         const std::function<double(double allowed)>& cost) const {
  if (wish_.off) return false;
  if (wish_.steps > 0) return step % wish_.steps == 0;
  const double since = now - made_at_, allowed = kShare * std::max(kShortest, now + left.value_or(0));
  if (wish_.seconds > 0) return since >= wish_.seconds && (!left || *left > 2 * cost(allowed));
  if (since < (any_ ? std::max(kLeastBetween, now * kPartOfCourse) : kFirstAfter)) return false;
  if (left && *left < 2 * cost(allowed)) return false;
  if (!any_) return !left || cost(allowed) <= kShareOfFirst * (now + *left);
  return since >= cost(allowed) / kShare;
}

void PreviewPace::made(double now) {
  made_at_ = now;
  any_ = true;
}

PreviewFrame preview_frame(const Captures& captures) {
  const auto held_out =
      std::find_if(captures.begin(), captures.end(), [](const Capture& capture) { return capture.test.size() > 0; });
  const bool any = held_out != captures.end();
  const Capture& capture = any ? *held_out : captures.front();
  const PhotoStore& photos = any ? capture.test : capture.train;
  const FramePixels photo = *photos[0];
  const Frame& frame = capture.scene.frames[photo.frame];
  PreviewFrame preview{photo,
                       view_of(frame, photos.listed().cameras[static_cast<std::size_t>(photo.camera)],
                               any ? static_cast<int>(held_out - captures.begin()) : 0),
                       frame.image,
                       any,
                       frame.camera,
                       0};
  const std::vector<std::size_t> trained = frames_of(capture.scene, Split::train);
  if (!any)
    preview.place = static_cast<std::size_t>(std::ranges::find(trained, std::size_t{photo.frame}) - trained.begin());
  const double scale = static_cast<double>(kLargestPreview) / std::max(photo.width, photo.height);
  if (scale < 1) shrink(preview, scale);
  return preview;
}

double Previews::probed_cost() {
  const Camera& camera = frame_.view.camera;
  const double scale = std::min(1.0, kProbe / std::max(camera.width, camera.height));
  View few = frame_.view;
  few.camera = resized(camera, scaled_side(camera.width, scale), scaled_side(camera.height, scale));
  method_.render(few);  // may compile kernels
  const double begun = steady_seconds();
  method_.render(few);
  return std::max(1e-6, (steady_seconds() - begun) / (scale * scale));
}

double Previews::cost(double allowed) {
  if (cost_ == 0) cost_ = probed_cost();
  const double least = static_cast<double>(kLeastPreview) / std::max(frame_.photo.width, frame_.photo.height);
  const double scale = std::max(least, std::sqrt(allowed / cost_));
  if (scale >= 1) return cost_;
  shrink(frame_, scale);
  return cost_ *= scale * scale;
}

View Previews::view_now() const {
  View view = frame_.view;
  if (!cameras_) return view;
  const std::vector<LensChange> lenses = cameras_->lens_changes(view.scene);
  if (!lenses.empty()) view.camera = with_lens(view.camera, lenses.at(static_cast<std::size_t>(frame_.camera)));
  const std::vector<Eigen::Matrix4d> poses = cameras_->refined_poses(view.scene);
  if (!frame_.held_out && !poses.empty()) view.world_from_camera = poses.at(frame_.place);
  return view;
}

fs::path Previews::make(int64_t step) {
  const double begun = steady_seconds();
  const Picture picture = method_.render(view_now());
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
