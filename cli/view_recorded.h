// What was recorded of a run's scene, to look at beside what is rendered: photos and LiDAR sweeps, from the capture.
#pragma once
#include <mutex>
#include <optional>

#include "cli/view_jobs.h"
#include "models/runs/restore_run.h"

namespace cloam {

class Recorded {
 public:
  Recorded(const StoredRun& run, int log);
  /// The photo of that frame of the run's scene, as JPEG of at most 1920 pixels a side. Fault::data where it is
  /// missing.
  Answer photo(std::size_t frame);
  /// The sweep nearest to that time: x, y, z in the world as float32, little-endian.
  Answer lidar(double time);

 private:
  const Scene& capture();

  const std::filesystem::path folder_;
  const RunData data_;
  const Reading reading_;
  std::vector<std::string> names_;  // of the frames
  std::mutex mutex_;
  std::optional<Scene> capture_;  // read when first asked for
};

}  // namespace cloam
