// See as_recorded.h.
#include "models/synth/as_recorded.h"

#include <algorithm>
#include <cmath>

#include "models/data/pandaset.h"

namespace cloam {
namespace {

using Eigen::Matrix4d;
using Eigen::Vector3d;

constexpr double kTurn = 0.1, kShutter = 0.03;                   // seconds
constexpr double kSweepStamp = 0.5 * kTurn, kImageStamp = 0.01;  // of --as-recorded: the sweep's end, last rows
const Vector3d kSecondLidar(0.4, 1.2, -0.4);                     // from the first, on the front of the roof
const CarBox kCar{{0, 0, -1.375}, {1.8, 4.8, 1.05}};             // from the LiDAR, 1.9 m high
constexpr double kCarRows = 260.0 / 1080;                        // of the back camera, as in PandaSet
constexpr std::uint8_t kCarColour[] = {46, 48, 54};

Vector3d middle_of(const MadeStreet& street, const StreetActor& actor, double time) {
  return actor.at(street.world.course, time, 0, 0).position + Vector3d(0, 0, 0.5 * actor.thing->bounds.sizes().z());
}

}  // namespace

Recording recording_of(const StreetLogOptions& options) {
  Recording recording;
  if (options.as_recorded || options.rolling_shutter) recording.sweep_seconds = kTurn;
  if (options.rolling_shutter) recording.shutter = kShutter;
  if (!options.as_recorded) return recording;
  recording.sweep_stamp = kSweepStamp;
  recording.image_stamp = kImageStamp;
  const MadeStreet anywhere{};
  recording.front_from_lidar =
      world_from_camera(anywhere, mount_of(kPandasetCameras[0]), 0).inverse() * world_from_lidar(anywhere, 0);
  recording.second_lidar = kSecondLidar;
  recording.car = kCar;
  recording.car_rows = {{"back_camera", kCarRows}};
  return recording;
}

double exposed_after(const StreetLogOptions& options, const Mount& mount) {
  return options.as_recorded ? -kTurn * mount.yaw / (2 * M_PI) : 0;
}

double seen_time(const MadeStreet& street, const StreetActor& actor, double middle, const Recording& recording) {
  double time = middle;
  for (int i = 0; recording.sweep_seconds > 0 && i < 4; ++i) {  // both move on meanwhile
    const Vector3d way =
        (world_from_lidar(street, time).inverse() * middle_of(street, actor, time).homogeneous()).head<3>();
    time = middle - recording.sweep_seconds * std::atan2(-way.x(), way.y()) / (2 * M_PI);
  }
  return time;
}

void cover_rows(StreetPicture& picture, double share) {
  const int width = picture.image.width, height = picture.image.height;
  const auto first = static_cast<std::size_t>(std::floor((1 - share) * height)) * std::size_t(width);
  for (std::size_t pixel = first; pixel < picture.actor.size(); ++pixel) {
    std::copy(std::begin(kCarColour), std::end(kCarColour), picture.image.pixels.begin() + std::ptrdiff_t(3 * pixel));
    picture.actor[pixel] = 0;
    picture.depth[pixel] = 0;
  }
}

}  // namespace cloam
