// A log of an edited run, written as a driving log in PandaSet's layout: images rendered, LiDAR measured where the edit
// touches it.
#pragma once
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "models/io/image.h"
#include "models/runs/listener.h"
#include "models/runs/restore_run.h"
#include "models/street/simulate.h"

namespace cloam {

struct SimulatedLog {
  int number = 0;  // of the run's logs
  Scene recorded;
  std::vector<std::string> cameras;  // empty: all
  std::optional<ImageSize> size;
};

struct LogCount {
  std::size_t images = 0, sweeps = 0, returns = 0, measured = 0, changed = 0, gone = 0;
  LogCount& operator+=(const LogCount& more);
};

/// What is to be written: the edited log with the cameras and names of the output, labels of what is seen, and boxes as
/// they were learned. Tells which cameras get other names. Fault::usage for cameras that the log does not have, and for
/// more than six.
Scene output_log(const RestoredRun& run, const SimulatedLog& wish, const Listener& listener);

/// The log `out` on its way into a folder, one part after the other in any order. What it is given lives longer.
class SimulatedLogWriter {
 public:
  SimulatedLogWriter(const RestoredRun& run, const SimulatedLog& wish, const Scene& out, std::filesystem::path folder);
  std::size_t images() const { return out_.frames.size(); }
  std::size_t sweeps() const { return out_.sweeps.size(); }
  std::string image_name(std::size_t image) const;
  std::string sweep_name(std::size_t sweep) const;
  LogCount write_image(std::size_t image) const;
  /// Fault::data for a recorded sweep that is missing.
  LogCount write_sweep(std::size_t sweep) const;
  /// All else, once the images and sweeps are there.
  void write_rest() const;

 private:
  const RestoredRun& run_;
  const EditedLog log_;
  const Scene& out_;
  const std::filesystem::path folder_;
};

}  // namespace cloam
