// cloam export: whole scenes as meshes and points.
#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "cli/export.h"
#include "cli/stop_signal.h"
#include "models/eval/seen_points.h"
#include "models/gaussians/exports_actors.h"
#include "models/gaussians/formats.h"
#include "models/gaussians/turn.h"
#include "models/io/words.h"
#include "models/mesh/density_mesh.h"
#include "models/mesh/parts.h"
#include "models/methods/registry.h"
#include "models/runs/actor_names.h"
#include "models/street/has_surfaces.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr double kStreetReach = 80;  // metres, of points: beyond, a pixel is wider than most things

std::string numbers(const Eigen::Vector3d& values) {
  const Eigen::Vector3d plain = values.array() + 0.0;  // no negative zeros
  return fmt::format("{:.6g} {:.6g} {:.6g}", plain.x(), plain.y(), plain.z());
}

MeshLabel world_label(const RestoredRun& run, const Scene& scene) {
  MeshLabel label = run_label(run, run.record.method);
  label.axes =
      text("world axes of the capture; up ", numbers(scene.up), "; ", scene.metric ? "metres" : "its own units");
  label.gltf_from_mesh = turn_between(scene.up.normalized(), Eigen::Vector3d::UnitY());
  return label;
}

/// Of the run's scenes: the one of --log, or the only one.
int scene_asked_for(const RestoredRun& run, const ExportRequest& request) {
  const std::vector<std::string> names = log_names(run.record);
  if (!request.log.empty()) return find_log(names, request.log);
  if (names.size() > 1)
    throw Error(Fault::usage,
                text("this run has ", names.size(), " logs: choose one with --log\n  logs: ", joined(names)));
  return 0;
}

/// Leaves out what --least-part says, writes the file and tells of it.
int write_scene_mesh(Mesh& mesh, const ExportRequest& request, MeshLabel label, const Common& common) {
  label.extras["resolution"] = request.resolution;
  const std::size_t dropped = drop_small_parts(mesh, request.least_part);
  write_mesh(request.out, mesh, label);
  nlohmann::ordered_json json = {{"schema_version", 1},
                                 {"path", request.out},
                                 {"vertices", mesh.vertex_count()},
                                 {"triangles", mesh.triangle_count()},
                                 {"parts_dropped", dropped}};
  if (label.extras.contains("level")) json["level"] = label.extras["level"];
  if (common.json) put_json(json);
  say(common, fmt::format("{}: {} vertices, {} triangles{}", request.out, mesh.vertex_count(), mesh.triangle_count(),
                          dropped > 0 ? fmt::format("; {} small parts left out", dropped) : ""));
  return 0;
}

/// --out as the file of a surface. Fault::usage for a format of something else.
void take_surface_file(ExportRequest& request) {
  const auto is_wanted = [&](const char* extension) { return "." + request.format == extension; };
  if (!request.format.empty() && std::none_of(std::begin(kMeshExtensions), std::end(kMeshExtensions), is_wanted))
    throw Error(Fault::usage,
                text("--format ", request.format, ": a surface is written as glb, obj or ply\n  fix: for ",
                     "pictures all around, cloam render RUN --path orbit"));
  take_mesh_file(request);
}

}  // namespace

int export_density(const RestoredRun& run, const HasDensity& method, ExportRequest request, const Common& common) {
  if (!request.actor.empty()) throw Error(Fault::usage, "--actor: this run has one scene, and no actors");
  take_surface_file(request);
  const DensityField field = method.density_field();
  DensitySurface surface{field.subject, request.resolution, request.level};
  if (surface.level == 0) surface.level = usual_level(surface.bounds);
  Mesh mesh = density_mesh(field, surface);
  if (mesh.triangle_count() == 0)
    throw Error(Fault::data, fmt::format("no density of the run reaches {:.4g} in its box: there is no surface\n  "
                                         "fix: train for longer, or choose a lower --level",
                                         surface.level));
  MeshLabel label = world_label(run, run.scenes.front());
  label.extras["level"] = surface.level;
  return write_scene_mesh(mesh, request, label, common);
}

int export_background(const RestoredRun& run, ExportRequest request, const Common& common) {
  if (!request.actor.empty()) throw Error(Fault::usage, "give either --actor or --background, not both");
  const int scene = scene_asked_for(run, request);
  if (const auto* exports = as<ExportsActors>(*run.method)) {
    check_file(request);
    const fs::path path = with_format(request.out, request.format);
    const Gaussians gaussians = exports->background_gaussians();
    write_gaussians(path, gaussians);
    if (common.json) put_json({{"schema_version", 1}, {"path", path.string()}, {"gaussians", gaussians.count()}});
    say(common, text(path.string(), ": ", gaussians.count(), " Gaussians"));
    return 0;
  }
  auto& street = require<HasSurroundings>(*run.method, run.record.method, "--background");
  take_surface_file(request);
  Mesh mesh = street.surroundings(scene, request.resolution);
  if (mesh.triangle_count() == 0)
    throw Error(Fault::data,
                "the street has no surface where its LiDARs saw something; was it trained for long enough?");
  const Scene& log = run.scenes[static_cast<std::size_t>(scene)];
  return write_scene_mesh(mesh, request, world_label(run, log), common);
}

int export_points(const RestoredRun& run, const ExportRequest& request, const Common& common) {
  if (!request.actor.empty()) throw Error(Fault::usage, "--format points is of a whole scene: leave out --actor");
  check_file(request);
  const fs::path path = fs::path(request.out).has_extension() ? request.out : request.out + ".ply";
  if (lower_case(path.extension().string()) != ".ply")
    throw Error(Fault::usage, text("-o ", request.out, ": points are written as .ply"));
  const int index = scene_asked_for(run, request);
  const Scene& scene = run.scenes[static_cast<std::size_t>(index)];
  SeenPointsWish wish{static_cast<std::size_t>(request.points)};
  if (scene.is_log) wish.farthest = kStreetReach;
  if (request.farthest > 0) wish.farthest = request.farthest;
  const StopOnSignal signals("finishing this photo");
  const Mesh points = seen_points(require<RendersViews>(*run.method, run.record.method, "--format points"), scene,
                                  index, wish, listener_of(common));
  if (points.vertex_count() == 0)
    throw Error(Fault::data, "no ray of a training photo ends at a surface: there are no points to write");
  write_points(path, points, world_label(run, scene));
  if (common.json) put_json({{"schema_version", 1}, {"path", path.string()}, {"points", points.vertex_count()}});
  say(common, text(path.string(), ": ", points.vertex_count(), " points"));
  return 0;
}

}  // namespace cloam
