// See view_recorded.h.
#include "cli/view_recorded.h"

#include <algorithm>
#include <cmath>

#include "models/data/load_sweep.h"
#include "models/io/image.h"
#include "models/runs/captures.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr int kLargestPhotoSide = 1920;

/// Whole, upright as it is stored, on white.
Image opaque(const Image& image) {
  const std::vector<std::uint8_t> rgba = as_rgba(image);
  Image out{image.width, image.height, 3, {}};
  for (std::size_t i = 0; i < rgba.size(); i += 4)
    for (std::size_t c = 0; c < 3; ++c)
      out.pixels.push_back(static_cast<std::uint8_t>((rgba[i + c] * rgba[i + 3] + 255 * (255 - rgba[i + 3])) / 255));
  return out;
}

}  // namespace

Recorded::Recorded(const StoredRun& run, int log)
    : folder_(run.folder),
      data_(run.record.data.at(static_cast<std::size_t>(log))),
      reading_(reading_for(run.record, false, false)) {
  for (const Frame& frame : run.scenes.at(static_cast<std::size_t>(log)).frames) names_.push_back(frame.name);
}

const Scene& Recorded::capture() {
  const std::lock_guard lock(mutex_);
  if (!capture_) capture_ = read_scene_as_listed(find_data(folder_, data_), reading_);
  return *capture_;
}

Answer Recorded::photo(std::size_t frame) {
  if (frame >= names_.size()) throw Refused(404, text("there is no photo ", frame, ": there are ", names_.size()));
  const Scene& scene = capture();
  const auto found =
      std::find_if(scene.frames.begin(), scene.frames.end(), [&](const Frame& f) { return f.name == names_[frame]; });
  if (found == scene.frames.end()) bad_data(scene.root.string(), ": the image ", names_[frame], " is missing");
  Image image = opaque(photo_of(scene, *found));
  const double shrink = std::max(1.0, std::max(image.width, image.height) / static_cast<double>(kLargestPhotoSide));
  if (shrink > 1)
    image = resized(image, static_cast<int>(std::lround(image.width / shrink)),
                    static_cast<int>(std::lround(image.height / shrink)));
  const std::vector<std::uint8_t> bytes = jpeg_bytes(image);
  return {{bytes.begin(), bytes.end()}, "image/jpeg"};
}

Answer Recorded::lidar(double time) {
  const Scene& scene = capture();
  const auto nearest = std::min_element(scene.sweeps.begin(), scene.sweeps.end(), [&](const Sweep& a, const Sweep& b) {
    return std::abs(a.timestamp - time) < std::abs(b.timestamp - time);
  });
  if (nearest == scene.sweeps.end()) throw Refused(404, "the capture has no LiDAR sweeps");
  const std::vector<float> positions = load_sweep(scene, *nearest).positions;
  const auto* bytes = reinterpret_cast<const char*>(positions.data());
  return {{bytes, bytes + positions.size() * sizeof(float)}, "application/octet-stream"};
}

}  // namespace cloam
