// A rendering as a request: what the command line and the demo fill in.
#pragma once
#include <optional>
#include <string>

#include "cli/common.h"

namespace cloam {

struct RenderRequest {
  std::string run, out, split = "test", path, data, camera;
  int frames = 60;
  bool exr = false, allow_outside = false;
  std::string log, camera_name, size;  // of logs: number or name; a camera's name; "640x360"
  std::string time;                    // seconds on the log's clock, or with a + after its first image
  std::optional<int> step;
  bool masks = false, lidar = false;
};

/// Writes one picture a view into request.out, and a GIF and a film of a path. Errors as the program's faults.
int run_render(const RenderRequest& request, const Common& common);

}  // namespace cloam
