// A made street as a driving log in PandaSet's layout, with the truth that real logs lack beside it (docs/formats.md).
#pragma once
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

namespace cloam {

struct StreetLogOptions {
  std::vector<std::string> cameras = {"front_camera", "front_left_camera"};  // of kPandasetCameras
  int frames = 20;
  double rate = 10;  // frames and sweeps a second: PandaSet's; 2 is that of nuScenes' keyframes
  int width = 320, height = 180;
  int beams = 32;
  bool night = false;
  double clouds = 0;             // share of the sun's light that comes from all over the sky instead
  double sway = 0;               // degrees, MadeStreet::sway
  double aside = 0;              // metres that actors who move keep further to their right
  bool rolling_shutter = false;  // pictures take 30 ms and sweeps 100 ms, in which all goes on moving
  bool as_recorded = false;      // with the clock, the second LiDAR and the car's own body of a real log
  bool dead_lidar = false;       // with as_recorded: lidar/poses.json stands still at the first pose
  bool truth = true;
  std::uint64_t seed = 0;
};

/// A seed for each log of a set.
std::uint64_t street_log_seed(std::uint64_t seed, int log);

/// Whether a log of the set is at night: each with this probability, and the logs before it together with it in the
/// same proportion, as nearly as whole logs allow (systematic sampling).
bool street_log_night(std::uint64_t seed, int log, double probability);

/// How many pictures write_street_log makes.
int street_log_pictures(const StreetLogOptions& options);

/// Writes the log of a seed below `root` and calls `on_picture` after each picture. Equal options give equal bytes,
/// whatever the number of cores. Fault::usage for options out of range; Fault::write.
void write_street_log(const std::filesystem::path& root, const StreetLogOptions& options,
                      const std::function<void()>& on_picture = {});

}  // namespace cloam
