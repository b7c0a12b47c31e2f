// The moments that the steps of a log are counted by, where sensors run at rates of their own.
#pragma once
#include <string>
#include <vector>

#include "models/scene/scene.h"

namespace cloam {

class Moments {
 public:
  Moments() = default;
  /// Seconds, in any order; of equal ones one counts.
  explicit Moments(std::vector<double> times);

  bool empty() const { return times_.empty(); }
  /// The step. There must be one.
  int nearest(double time) const;
  /// Seconds from there.
  double distance(double time) const;
  /// At most one usual interval away.
  bool near(double time) const { return distance(time) <= usual_gap_; }
  std::string range() const;

 private:
  std::vector<double> times_;
  double usual_gap_ = 0;
};

/// Of each camera (Frame::sensor) the frame nearest in time to each step, with that step, in the order given. Frames
/// have time stamps; those that are near no step, or further from it than another, are left out.
std::vector<Frame> nearest_frames(const std::vector<Frame>& frames, const Moments& moments);

}  // namespace cloam
