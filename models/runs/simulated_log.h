// A log of an edited run, written as a driving log in PandaSet's layout: images rendered, LiDAR measured where the edit
// touches it.
#pragma once
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "models/io/image.h"
#include "models/runs/listener.h"
#include "models/runs/restore_run.h"

namespace cloam {

struct SimulatedLog {
  int number = 0;  // of the run's logs
  Scene recorded;
  std::vector<std::string> cameras;  // empty: all
  std::optional<ImageSize> size;
};

struct LogCount {
  std::size_t images = 0, sweeps = 0, returns = 0, measured = 0, changed = 0, gone = 0;
};

/// What is to be written: the edited log with the cameras and names of the output, and labels of what is seen. Tells
/// which cameras get other names. Fault::usage for cameras that the log does not have, and for more than six.
Scene output_log(const RestoredRun& run, const SimulatedLog& wish, const Listener& listener);

/// Called with the name of each image and sweep and what makes it.
struct AroundWork {
  std::function<void(const std::string&name, const std::function<void()>&make)> image, sweep;
};

/// Writes the log `out` into the folder. Fault::data for a recorded sweep that is missing.
LogCount write_simulated_log(const RestoredRun& run, const SimulatedLog& wish, const Scene& out,
                             const std::filesystem::path& folder, const AroundWork& around);

}  // namespace cloam
