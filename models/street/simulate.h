// The LiDAR of an edited log: what was recorded, but for the rays that the edit touches.
#pragma once
#include <map>

#include "models/data/load_sweep.h"
#include "models/street/street.h"

namespace cloam {

struct SweepEdit {
  LidarPoints points;
  std::size_t measured = 0;  // rays that were asked of the street
  std::size_t changed = 0;   // returns that differ from the recorded ones, those that are gone included
  std::size_t gone = 0;      // returns that nothing sends back any more
};

/// A log before and after its actors were edited; scene is the place of `edited` in its run.
struct EditedLog {
  const Scene& recorded;
  const Scene& edited;
  int scene = 0;
};

/// The recorded points of a sweep of log.recorded as the edited log would return them. Along the recorded directions,
/// from the LiDAR's place when it saw them, the street is asked (at that time) for
///   - returns within 0.2 m of the recorded box of an actor who was edited, at the sweep's time or at their own: they
///     become what is behind; where the street still sees something inside that box, with no actor's box there now (the
///     ghost of the actor), the ray goes on from the box's far side, and ends on its bottom if it leaves there and
///     meets no more;
///   - rays that meet the new box of an edited actor before their recorded return: where the street has that actor
///     there, they end on it.
/// Where the street knows them, changed returns have its intensity, and none comes back where more likely none does.
/// All else stays bit for bit; rays that meet nothing have no return.
SweepEdit edited_sweep(Street& street, const EditedLog& log, const Sweep& sweep, const LidarPoints& recorded);

}  // namespace cloam
