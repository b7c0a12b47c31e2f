// The views that a rendering asks for.
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "cli/common.h"
#include "models/runs/restore_run.h"
#include "models/scene/view.h"

namespace cloam {

struct RenderRequest {
  std::string show;  // the first picture in the terminal, as add_show has it
  std::string run, out, split = "test", path, data, camera;
  int frames = 60;
  bool exr = false, allow_outside = false;
  std::string log, camera_name, size;  // of logs: number or name; a camera's name; "640x360"
  std::string time;                    // seconds on the log's clock, or with a + after its first image
  std::optional<int> step;
  bool masks = false, lidar = false;
  std::string draw = "colour";  // colour, depth, normals, opacity, ellipsoids or samples
};

struct NamedView {
  std::string name;  // of its files
  View view;
};

/// Views of a camera file are named after this: camera_0000 and on.
constexpr char kCameraFileViews[] = "camera";

/// Of the run's captures (all, or --log), or of --data: the images of the split, or those of one step; a camera at any
/// time between its images; an orbit, or a path through the cameras; cameras from a file. Needs no images: the geometry
/// is in the run folder. Fault::usage for names that the run does not have, and for times outside a camera's images.
std::vector<NamedView> views_of(const RestoredRun& run, const RenderRequest& request);

/// The numbers of the scenes that --log asks for: one, or all.
std::vector<int> scenes_asked_for(const RestoredRun& run, const RenderRequest& request);

}  // namespace cloam
