// What the log of a run (metrics.jsonl) says of its training, from the first step to where it stands.
#pragma once
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace cloam {

struct RunHistory {
  struct Point {
    int64_t step = 0;
    double value = 0;
  };
  using Series = std::vector<Point>;  // by step

  Series loss, psnr, rate;  // means since the point before; psnr: of the training batch
  Series held_out;          // PSNR of previews
  double seconds = 0;       // of all trainings of the run, with those parts that were lost
  int trainings = 0;        // 1, and one more each time that it went on
  std::vector<std::string> warnings;
  std::vector<std::string> commands;  // that began and continued it
};

/// Steps that a kill lost and a later training made again count once. No file: an empty history. A last line that a
/// kill cut is left out; Fault::data for another line that is no event.
RunHistory read_history(const std::filesystem::path& log);

}  // namespace cloam
