// See recorded_log.h.
#include "models/runs/recorded_log.h"

#include <algorithm>
#include <chrono>

#include "models/data/load_images.h"
#include "models/data/load_sweep.h"
#include "models/data/pandaset.h"
#include "models/data/reader.h"
#include "models/io/commit.h"
#include "models/io/words.h"
#include "models/render/undistort.h"
#include "models/runs/edit_run.h"
#include "models/runs/interrupted.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr double kSecondsBetweenNews = 5;

/// What is to be read of the log: all photos, and nothing of what the layout has no place for.
Scene without_masks(Scene log, const Listener& listener) {
  const auto masked = std::ranges::count_if(log.frames, [](const Frame& frame) { return frame.mask.has_value(); });
  if (masked > 0) listener.warn(text(masked, " masks are left out: PandaSet's layout has none"));
  for (Frame& frame : log.frames) {
    frame.split = Split::train;
    frame.mask = {};
  }
  return log;
}

/// Photos as pinholes take them.
class StraightPhotos {
 public:
  StraightPhotos(const Scene& log, bool skip_bad)
      : log_(log), photos_(store_images(log, Split::train, {1, skip_bad}, std::make_shared<HostStore>(0, 0))) {
    for (const Camera& lens : photos_.listed().cameras) {
      pinholes_.push_back(pinhole_within(lens));
      maps_.push_back(pixel_map(pinholes_.back(), lens));
    }
  }

  const std::vector<std::string>& warnings() const { return photos_.listed().warnings; }
  const std::vector<Camera>& pinholes() const { return pinholes_; }
  /// Those of the log that are sound, with the numbers of their pinholes.
  std::vector<Frame> frames() const {
    std::vector<Frame> out;
    for (const FramePixels& photo : photos_.listed().frames)
      (out.emplace_back(log_.frames[photo.frame])).camera = photo.camera;
    return out;
  }

  /// out: the log with these frames, of which this is the one of that number.
  void write(const fs::path& folder, const Scene& out, std::size_t number) const {
    const FramePixels& photo = photos_.listed().frames[number];
    const Frame &from = log_.frames[photo.frame], &to = out.frames[number];
    const auto camera = static_cast<std::size_t>(photo.camera);
    if (maps_[camera].same && is_plain_jpeg(from, pinholes_[camera]))
      return commit_link(log_.root / from.image, folder / "camera" / to.sensor / (pandaset_number(to.step) + ".jpg"));
    const FramePixels straight = resample(*photos_[number], maps_[camera]);
    write_pandaset_image(folder, out, to, rgb_of(straight));
  }

 private:
  /// A file that stands for itself in another place, as is.
  bool is_plain_jpeg(const Frame& frame, const Camera& camera) const {
    const std::string extension = lower_case(fs::path(frame.image).extension().string());
    if ((extension != ".jpg" && extension != ".jpeg") || frame.linear.value_or(false) || frame.exposure != 1)
      return false;
    const ImageSize stored = peek_image_size(log_.root / frame.image);
    return stored.width == camera.width && stored.height == camera.height;
  }

  static Image rgb_of(const FramePixels& photo) {
    Image out{photo.width, photo.height, 3, {}};
    for (std::size_t i = 0; i < photo.rgba.size(); ++i)
      if (i % 4 != 3) out.pixels.push_back(photo.rgba[i]);
    return out;
  }

  const Scene& log_;
  const PhotoStore photos_;
  std::vector<Camera> pinholes_;  // of photos_.listed().cameras
  std::vector<PixelMap> maps_;
};

/// Tells now and then how far it is.
class LogNews {
 public:
  LogNews(const Listener& listener, std::size_t all) : listener_(listener), all_(all) {}

  void next() {
    ++done_;
    const std::chrono::duration<double> since = Clock::now() - told_, whole = Clock::now() - began_;
    if (since.count() < kSecondsBetweenNews) return;
    told_ = Clock::now();
    const double left = whole.count() / static_cast<double>(done_) * static_cast<double>(all_ - done_);
    listener_.say(text("log ", done_, "/", all_, " photos and sweeps, ", words_for_seconds(left), " left"));
  }
  void check_stop() const {
    listener_.check_stop([&] { return text(done_, " of ", all_, " photos and sweeps were written"); });
  }

 private:
  using Clock = std::chrono::steady_clock;
  const Listener& listener_;
  const std::size_t all_;
  std::size_t done_ = 0;
  const Clock::time_point began_ = Clock::now();
  Clock::time_point told_ = began_;
};

}  // namespace

void tell_renamed(const PandasetLog& log, const Listener& listener) {
  for (const auto& [sensor, name] : log.renamed) listener.say(text("the camera ", sensor, " is written as ", name));
}

void write_recorded_log(const fs::path& folder, const Scene& given, bool skip_bad, const Listener& listener) {
  check_new_folder(folder);
  const Scene log = without_masks(given, listener);
  const StraightPhotos photos(log, skip_bad);
  Scene sound = log;
  sound.frames = photos.frames();
  PandasetLog out = as_pandaset(sound, photos.pinholes());
  // Each sweep has its pose: it follows the front camera no more.
  out.scene.recording.front_from_lidar = {};
  tell_renamed(out, listener);
  std::vector<std::string> warnings = photos.warnings();
  LogNews news(listener, sound.frames.size() + log.sweeps.size());
  try {
    for (std::size_t i = 0; i < sound.frames.size(); ++i) {
      news.check_stop();
      photos.write(folder, out.scene, i);
      news.next();
    }
    for (const Sweep& sweep : log.sweeps) {
      news.check_stop();
      guarded(skip_bad, warnings, "sweep dropped",
              [&] { write_pandaset_sweep(folder, sweep, load_sweep(log, sweep)); });
      news.next();
    }
  } catch (const Interrupted& interrupted) {
    std::error_code error;
    fs::remove_all(folder, error);  // it is new
    throw Interrupted(interrupted.signal(),
                      text(interrupted.what(), "; ", folder.string(), " was incomplete and has been removed"));
  }
  write_pandaset_rest(folder, out.scene);
  for (const std::string& warning : warnings) listener.warn(warning);
}

}  // namespace cloam
