// Which images and sweeps train and which are measured: every nth, or one of the protocols of driving logs.
#pragma once
#include <string>
#include <vector>

#include "models/scene/scene.h"

namespace cloam {

/// Sorts the frames by name and makes every nth of them, from the first on, the test split; all others train. In a log
/// every nth step is, with the images of all cameras and the sweep.
/// A split that the source gave is forgotten. Fault::usage for n < 2, which would leave nothing to train on.
void apply_holdout(Scene& scene, int n);

struct Protocol {
  std::string name;      // "sparse", "novel", "rotate360"
  int sparse_every = 0;  // steps between the training images of sparse; 0: 10 from 40 front images up, else 5
};

const std::vector<std::string>& protocol_names();

/// Splits a log; images that neither train nor are measured become Split::unused.
///   sparse     trains on the front images of steps 0, k, 2k, ... and of the last, is measured on the other front
///              images; the sweeps of the training steps train, the others are measured (a sweep of a measured moment
///              would show what is asked for)
///   novel      trains on all front images, is measured on those of the camera beside it, front left; all sweeps train
///   rotate360  trains on all front images and sweeps; measured are turned actors, of which the log has no image
/// Fault::usage for an unknown name and for captures that are no log.
void apply_protocol(Scene& scene, const Protocol& protocol);

/// The frame of a log that "front_camera/05" names: its sensor and step. Fault::usage for a capture that is no log and
/// for a name that is none of its frames', saying which there are.
std::size_t frame_named(const Scene& scene, const std::string& image);

/// That image alone trains, and the sweep of its step; all else is unused. Errors as frame_named.
void apply_image(Scene& scene, const std::string& image);

/// The camera that looks ahead: "front_camera" (PandaSet), "image_02" (KITTI), "CAM_FRONT" (nuScenes), else that of the
/// first frame (so a rig lists its front camera first). Empty for a capture without frames.
std::string front_sensor(const Scene& scene);
/// The names of the cameras, in the order of their first frames.
std::vector<std::string> sensors_of(const Scene& scene);
/// The camera that novel is measured on. A log without it has nothing to measure there (KITTI has none).
constexpr char kFrontLeftSensor[] = "front_left_camera";

}  // namespace cloam
