// What the parts of cloam export share.
#pragma once
#include <string>

#include "cli/commands.h"
#include "models/mesh/has_density.h"
#include "models/mesh/write_mesh.h"
#include "models/runs/restore_run.h"

namespace cloam {

struct ExportRequest {
  std::string run, format, actor, out, log;
  bool background = false;
  int resolution = 128, frames = 36, size = 256, points = 1000000;
  double level = 0, least_part = 0, farthest = 0;  // level 0: usual_level; farthest 0: kStreetReach of streets
};

/// Fault::usage unless --out is a file to be written.
void check_file(const ExportRequest& request);

/// --out as the file of a mesh: its name may say the format, which is glb where nothing says it. Fault::usage.
void take_mesh_file(ExportRequest& request);

/// What a file says of how a mesh of the run was made.
MeshLabel run_label(const RestoredRun& run, const std::string& name);

// Each exports what its name says, and gives the exit code.

/// The surface of a radiance field.
int export_density(const RestoredRun& run, const HasDensity& method, ExportRequest request, const Common& common);
/// A street without its actors: its surface, or its gaussians.
int export_background(const RestoredRun& run, ExportRequest request, const Common& common);
/// The data once more, with the cameras or the boxes that the run learned. Fault::usage for a run that learned neither.
int export_capture(const RestoredRun& run, const ExportRequest& request, const Common& common);
/// What the training photos' cameras see, as points.
int export_points(const RestoredRun& run, const ExportRequest& request, const Common& common);

}  // namespace cloam
