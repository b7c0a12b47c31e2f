// See recorded_log.h.
#include "models/runs/recorded_log.h"

#include <algorithm>
#include <chrono>
#include <mutex>

#include "models/data/load_images.h"
#include "models/data/load_sweep.h"
#include "models/data/pandaset.h"
#include "models/data/reader.h"
#include "models/data/write_pandaset.h"
#include "models/io/commit.h"
#include "models/io/in_parallel.h"
#include "models/io/paths.h"
#include "models/io/words.h"
#include "models/render/undistort.h"
#include "models/runs/interrupted.h"
#include "models/runs/new_folder.h"
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
    if (maps_[camera].same && stands_for_itself(from, pinholes_[camera]))
      return commit_link(log_.root / from.image,
                         folder / "camera" / to.sensor / (pandaset_number(to.step) + extension_of(from)));
    const FramePixels straight = resample(*photos_[number], maps_[camera]);
    write_pandaset_image(folder, out, to, rgb_of(straight));
  }

 private:
  static std::string extension_of(const Frame& frame) { return lower_case(fs::path(frame.image).extension().string()); }

  /// Whether a reader makes of the file, in another place, what is made of it here.
  bool stands_for_itself(const Frame& frame, const Camera& camera) const {
    const std::string extension = extension_of(frame);
    if (extension != ".jpg" && extension != ".jpeg" && extension != ".png") return false;
    if (frame.linear.value_or(false) || frame.exposure != 1) return false;
    const ImageSize stored = peek_image_size(log_.root / frame.image);
    return stored.width == camera.width && stored.height == camera.height;
  }

  static Image rgb_of(const FramePixels& photo) {
    Image out{photo.width, photo.height, 3, {}};
    out.pixels.reserve(photo.rgba.size() / 4 * 3);
    for (std::size_t i = 0; i < photo.rgba.size(); ++i)
      if (i % 4 != 3) out.pixels.push_back(photo.rgba[i]);
    return out;
  }

  const Scene& log_;
  const PhotoStore photos_;
  std::vector<Camera> pinholes_;  // of photos_.listed().cameras
  std::vector<PixelMap> maps_;
};

/// Tells now and then how far it is; of several threads.
class LogNews {
 public:
  LogNews(const Listener& listener, std::size_t all) : listener_(listener), all_(all) {}

  void next() {
    const std::lock_guard lock(mutex_);
    ++done_;
    const std::chrono::duration<double> since = Clock::now() - told_, whole = Clock::now() - began_;
    if (since.count() < kSecondsBetweenNews) return;
    told_ = Clock::now();
    const double left = whole.count() / static_cast<double>(done_) * static_cast<double>(all_ - done_);
    listener_.say(text("log ", done_, "/", all_, " photos and sweeps, ", words_for_seconds(left), " left"));
  }
  void check_stop() {
    const std::lock_guard lock(mutex_);
    listener_.check_stop([&] { return text(done_, " of ", all_, " photos and sweeps were written"); });
  }

 private:
  using Clock = std::chrono::steady_clock;
  const Listener& listener_;
  const std::size_t all_;
  std::mutex mutex_;
  std::size_t done_ = 0;
  const Clock::time_point began_ = Clock::now();
  Clock::time_point told_ = began_;
};

/// What is written and where from.
struct RecordedLog {
  const fs::path& folder;
  const Scene& log;
  const StraightPhotos& photos;
  const Scene& out;  // the log with its photos' pinholes
};

/// Returns what was dropped, a line each.
std::vector<std::string> write_parts(const RecordedLog& recorded, bool skip_bad, const Listener& listener) {
  const std::vector<Sweep>& sweeps = recorded.log.sweeps;
  LogNews news(listener, recorded.out.frames.size() + sweeps.size());
  in_parallel(recorded.out.frames.size(), [&](std::size_t i) {
    news.check_stop();
    recorded.photos.write(recorded.folder, recorded.out, i);
    news.next();
  });
  std::vector<std::vector<std::string>> dropped(sweeps.size());
  in_parallel(sweeps.size(), [&](std::size_t i) {
    news.check_stop();
    guarded(skip_bad, dropped[i], "sweep dropped",
            [&] { write_pandaset_sweep(recorded.folder, sweeps[i], load_sweep(recorded.log, sweeps[i])); });
    news.next();
  });
  std::vector<std::string> all;
  for (std::vector<std::string>& of_sweep : dropped) all.insert(all.end(), of_sweep.begin(), of_sweep.end());
  return all;
}

/// What was begun; the folder is new.
void remove_begun(const fs::path& folder) {
  std::error_code error;
  fs::remove_all(folder, error);
}

/// Where the car was on Earth is no part of a Scene.
void link_places(const fs::path& folder, const Scene& log) {
  const fs::path file = "meta/gps.json";
  if (log.format == "PandaSet" && has_file(log.root / file)) commit_link(log.root / file, folder / file);
}

}  // namespace

void tell_renamed(const PandasetLog& log, const Listener& listener) {
  for (const auto& [sensor, name] : log.renamed) listener.say(text("the camera ", sensor, " is written as ", name));
}

void write_recorded_log(const fs::path& folder, const Scene& given, bool skip_bad, const Listener& listener) {
  check_new_folder(folder);
  const Scene log = without_masks(given, listener);
  const StraightPhotos photos(log, skip_bad);
  for (const std::string& warning : photos.warnings()) listener.warn(warning);
  Scene sound = log;
  sound.frames = photos.frames();
  if (sound.frames.empty()) throw Error(Fault::data, text(log.root.string(), ": no photo can be read"));
  PandasetLog out = as_pandaset(sound, photos.pinholes());
  // Each sweep has its pose: it follows the front camera no more.
  out.scene.recording.front_from_lidar = {};
  tell_renamed(out, listener);
  std::vector<std::string> dropped;
  try {
    dropped = write_parts({folder, log, photos, out.scene}, skip_bad, listener);
    write_pandaset_rest(folder, out.scene);
    link_places(folder, log);
  } catch (const Interrupted& interrupted) {
    remove_begun(folder);
    throw Interrupted(interrupted.signal(),
                      text(interrupted.what(), "; ", folder.string(), " was incomplete and has been removed"));
  } catch (...) {
    remove_begun(folder);
    throw;
  }
  for (const std::string& warning : dropped) listener.warn(warning);
}

}  // namespace cloam
