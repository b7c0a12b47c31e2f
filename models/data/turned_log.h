// Logs whose actors are turned about their own z axes: what the protocol rotate360 measures.
#pragma once
#include "models/scene/scene.h"

namespace cloam {

/// Counter-clockwise from above; the boxes keep their centres.
void turn_actors(Scene& scene, double degrees);

/// The log with its actors turned, whose test images are those of the front camera as they would then be:
/// truth/rot045/front_camera/07.jpg for 45 degrees. Where the log has none, has_truth is false and the test images are
/// those that the camera took. A moment at which the camera would be inside of a turned actor (a lorry beside the car,
/// turned by 90 degrees) is left out: there is no such image.
struct TurnedLog {
  Scene scene;
  int degrees = 0;
  bool has_truth = false;
};
TurnedLog turned_log(const Scene& log, int degrees);

}  // namespace cloam
