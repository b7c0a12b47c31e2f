// What the readers of driving logs share: missing files are warned of, damaged ones stop or are dropped, boxes become
// actors.
#pragma once
#include <map>
#include <string>
#include <vector>

#include "models/data/reader.h"

namespace cloam {

/// What one label file says of one actor at one moment.
struct LabelledBox {
  std::string id, label;
  Eigen::Vector3d size = Eigen::Vector3d::Zero();  // metres, along the box's axes
  bool stationary = false;
  ActorBox box;
};

/// Where the parts of a log were looked for, for messages.
struct LookedFor {
  const char *images, *sweeps, *boxes;
};

class LogBuilder {
 public:
  LogBuilder(const std::filesystem::path& root, const char* format, const ReadOptions& options);

  Scene scene;  // frames and sweeps go here

  /// Runs `step`, and with --skip-bad turns its complaint about the data into a warning.
  template <class Step>
  void guarded(const char* what, Step step) {
    cloam::guarded(options_.skip_bad, scene.warnings, text(what, " dropped"), step);
  }

  void missing(const std::string& file) { missing_.push_back(file); }

  /// Boxes come in the order of their steps; of two of one actor at one step the first stays. Fault::data, with
  /// `where` at its head, for poses and sizes that no box has; with --skip-bad that box alone is dropped.
  void add(const LabelledBox& labelled, const std::string& where);

  /// Warns of sweeps and boxes if there are none. Fault::data without any frame.
  Scene finish(const LookedFor& places);

 private:
  void add_sound(const LabelledBox& labelled, const std::string& where);

  ReadOptions options_;
  std::map<std::string, Actor> actors_;
  std::vector<std::string> missing_;
  int repeated_ = 0;
};

}  // namespace cloam
