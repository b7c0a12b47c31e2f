// Logs whose actors are turned about their own z axes: what the protocol rotate360 measures.
#pragma once
#include "models/scene/scene.h"

namespace cloam {

/// Counter-clockwise from above; the boxes keep their centres.
void turn_actors(Scene& scene, double degrees);

/// The angles that the protocol turns actors by: 0 to 315 degrees. At 0 they are as they were recorded.
inline constexpr int kTurnStep = 45, kFullTurn = 360;

/// Whether the log has an image of its actors turned by any of the protocol's angles but 0.
bool has_turned_truth(const Scene& log);

/// The log with its actors turned, whose test images are those of the front camera as they would then be:
/// truth/rot045/front_camera/07.jpg for 45 degrees. A log with such images of some angles or moments alone is measured
/// by those. One that has none is shown as it is: has_truth is false and the test images are those that the camera
/// took. A moment at which the camera would be inside of a turned actor (a lorry beside the car, turned by 90 degrees)
/// is left out: there is no such image. Turned by 0 degrees they are in the images that the camera took, of the moments
/// that are measured at another angle.
struct TurnedLog {
  Scene scene;
  int degrees = 0;
  bool has_truth = false;
  std::size_t possible = 0;  // test images, if there were truth for all
};
TurnedLog turned_log(const Scene& log, int degrees);

}  // namespace cloam
