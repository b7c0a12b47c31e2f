// --tb: what a training tells as events, also as event files that TensorBoard reads.
#pragma once
#include <cstdio>
#include <filesystem>
#include <memory>

#include "cli/progress.h"

namespace cloam {

/// RUN/events.out.tfevents.*, one file each time that a training starts or goes on. Like the log of a run it is told
/// once when it cannot be written and then left: it must not end a training.
class TensorBoardFile {
 public:
  /// step: where the training stands; what older files say of later steps no longer holds. Fault::write.
  TensorBoardFile(const std::filesystem::path& run, int64_t step);
  /// An event as EventLog writes it: the numbers of "step" as scalars, those and the picture of "eval".
  void take(const std::string& name, const Event& fields);

 private:
  void write(const std::string& records);

  std::unique_ptr<std::FILE, int (*)(std::FILE*)> file_{nullptr, std::fclose};
  bool failed_ = false;
};

}  // namespace cloam
