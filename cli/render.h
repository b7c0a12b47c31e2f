// A rendering as a request: what the command line and the demo fill in.
#pragma once
#include <string>

#include "cli/common.h"

namespace cloam {

struct RenderRequest {
  std::string run, out, split = "test", path, data, camera;
  int frames = 60;
  bool exr = false;
};

/// Writes one picture a view into request.out, and a GIF of an orbit. Errors as the program's faults.
int run_render(const RenderRequest& request, const Common& common);

}  // namespace cloam
