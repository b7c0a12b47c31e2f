// cloam export: surfaces as meshes, actors of a trained street also as turntables, and gaussians as files of splats.
#include "cli/export.h"

#include <fmt/format.h>

#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>

#include "cli/stop_signal.h"
#include "models/eval/pictures.h"
#include "models/gaussians/exports_actors.h"
#include "models/gaussians/exports_gaussians.h"
#include "models/gaussians/formats.h"
#include "models/gaussians/turn.h"
#include "models/io/gif.h"
#include "models/io/paths.h"
#include "models/methods/registry.h"
#include "models/metrics/psnr.h"
#include "models/render/undistort.h"
#include "models/runs/actor_names.h"
#include "models/runs/pack_prior.h"
#include "models/splat/draw.h"
#include "models/street/asset_mesh.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr int kFramesPerSecond = 12;
constexpr char kPrior[] = "prior", kCapture[] = "capture", kPoints[] = "points";
constexpr char kExportExamples[] =
    R"(Write surfaces, the actors of a street, or Gaussian splats, as files for other programs.

Examples:
  cloam export runs/lego -o lego.glb --resolution 256                     a NeRF's surface with colours; also .obj, .ply
  cloam export runs/street --format glb --actor 3f2a -o car.glb           a coloured mesh, in glTF's axes
  cloam export runs/street --format glb -o cars                           all actors, one file each
  cloam export runs/street --format turntable --actor 1:3f2a -o turn      pictures all around, and a GIF
  cloam export runs/street --format ply --actor 3f2a -o car.ply --resolution 256
  cloam export runs/street --background --log 003 -o street.glb --resolution 512    the street without its actors
  cloam export runs/lego --format points -o points.ply                    what the photos see, as coloured points
  cloam export runs/assets --format prior -o prior                        a diffusion and its networks, to hand on
  cloam export runs/garden --format capture -o garden-refined             the photos with poses and lenses that it learned
  cloam export runs/street --format capture -o street-refined             the log with the boxes that it learned
  cloam export runs/garden -o garden.ply                                  Gaussian splats; also .splat, .spz and .glb

An actor is [LOG:]ID, where ID is any unique part of its id and LOG the number or name of its log.)";

struct Exported {
  AssetName actor;
  std::string path;
  std::size_t vertices = 0, triangles = 0, pictures = 0, gaussians = 0;
};

MeshLabel label_of(const RestoredRun& run, const AssetName& name, int resolution) {
  const Actor& actor = actor_of(run.scenes, name);
  MeshLabel label = run_label(run, text(actor.label, " ", actor.id));
  label.extras.update({{"actor", actor.id},
                       {"label", actor.label},
                       {"size_m", {actor.size.x(), actor.size.y(), actor.size.z()}},
                       {"resolution", resolution}});
  return label;
}

Exported export_mesh(const RestoredRun& run, const ExportRequest& request, const AssetName& name,
                     const fs::path& path) {
  const Mesh mesh = asset_mesh(require<HasSurfaces>(*run.method, run.record.method, "a mesh"),
                               appearance_of(run.scenes, name), actor_of(run.scenes, name).size, request.resolution);
  if (mesh.triangle_count() == 0) {
    throw Error(Fault::data, text("the actor ", spelled(run.scenes, name),
                                  " has no surface in its box; was it visible, and trained for long enough?"));
  }
  write_mesh(path, mesh, label_of(run, name, request.resolution));
  return {name, path.string(), mesh.vertex_count(), mesh.triangle_count(), 0};
}

Exported export_turntable(const RestoredRun& run, const ExportRequest& request, const AssetName& name,
                          const fs::path& folder) {
  const std::vector<Image> images = turntable(street_of(run), appearance_of(run.scenes, name),
                                              actor_of(run.scenes, name).size, request.frames, request.size);
  for (std::size_t i = 0; i < images.size(); ++i) { write_png(folder / fmt::format("turn_{:04}.png", i), images[i]); }
  write_gif(folder / "turntable.gif", images, kFramesPerSecond);
  return {name, folder.string(), 0, 0, images.size()};
}

Exported export_gaussians(const RestoredRun& run, const ExportsActors& exports, const AssetName& name,
                          const fs::path& path) {
  const Gaussians gaussians = exports.actor_gaussians(appearance_of(run.scenes, name));
  if (gaussians.count() == 0)
    throw Error(Fault::data, text("the actor ", spelled(run.scenes, name), " has no Gaussians; was it visible?"));
  write_gaussians(path, gaussians);
  return {name, path.string(), 0, 0, 0, gaussians.count()};
}

Exported export_one(const RestoredRun& run, const ExportRequest& request, const AssetName& name, const fs::path& path) {
  if (request.format == "turntable") return export_turntable(run, request, name, path);
  const auto* exports = as<ExportsActors>(*run.method);
  return exports ? export_gaussians(run, *exports, name, path) : export_mesh(run, request, name, path);
}

/// A file (or a folder) name for an actor: ids come from files, so nothing but letters, digits, - and _ is kept.
std::string file_name(const Scenes& scenes, const AssetName& name, const std::string& format) {
  std::string plain;
  for (const char c : spelled(scenes, name)) plain += std::isalnum(static_cast<unsigned char>(c)) || c == '-' ? c : '_';
  return format == "turntable" ? plain : plain + "." + format;
}

std::vector<Exported> export_all(const RestoredRun& run, const ExportRequest& request, const Common& common) {
  std::vector<Exported> done;
  const StopOnSignal signals("finishing this actor");
  for (std::size_t scene = 0; scene < run.scenes.size(); ++scene) {
    for (const Actor& actor : run.scenes[scene].actors) {
      check_stop([&] { return text(done.size(), " actors are complete in ", request.out); });
      const AssetName name{static_cast<int>(scene), actor.id};
      try {
        done.push_back(
            export_one(run, request, name, fs::path(request.out) / file_name(run.scenes, name, request.format)));
        say(common, text("export ", done.size(), "  ", done.back().path));
      } catch (const Error& error) {
        if (error.fault() != Fault::data) throw;
        warn(error.what());  // an actor without a surface
      }
    }
  }
  return done;
}

/// Of a street of Gaussians, beside its actors.
Exported background_file(const ExportsActors& exports, const ExportRequest& request) {
  const fs::path path = fs::path(request.out) / ("background." + request.format);
  const Gaussians gaussians = exports.background_gaussians();
  write_gaussians(path, gaussians);
  return {{}, path.string(), 0, 0, 0, gaussians.count()};
}

void tell(const Scenes& scenes, const std::vector<Exported>& done, const Common& common,
          const std::optional<Exported>& background = {}) {
  nlohmann::ordered_json json = {{"schema_version", 1}, {"actors", nlohmann::ordered_json::array()}};
  if (background) {
    json["background"] = {{"path", background->path}, {"gaussians", background->gaussians}};
    say(common, text("background: ", background->gaussians, " Gaussians in ", background->path));
  }
  for (const Exported& one : done) {
    nlohmann::ordered_json row = {{"log", one.actor.scene}, {"actor", one.actor.actor_id}, {"path", one.path}};
    if (one.pictures > 0) row["pictures"] = one.pictures;
    if (one.triangles > 0) row["vertices"] = one.vertices, row["triangles"] = one.triangles;
    if (one.gaussians > 0) row["gaussians"] = one.gaussians;
    json["actors"].push_back(row);
    const std::string what = one.pictures > 0    ? text(one.pictures, " pictures and turntable.gif in ")
                             : one.gaussians > 0 ? text(one.gaussians, " Gaussians in ")
                                                 : text(one.vertices, " vertices, ", one.triangles, " triangles in ");
    say(common, text(spelled(scenes, one.actor), ": ", what, one.path));
  }
  if (common.json) put_json(json);
}

void check_export_folder(ExportRequest& request) {
  if (request.format.empty()) request.format = "glb";
  if (const std::string problem = problem_of(output_folder(), request.out); !problem.empty())
    throw Error(Fault::usage, text("--out: ", problem, request.actor.empty() ? "; or one actor: --actor ID" : ""));
}

int export_actors(const RestoredRun& run, ExportRequest request, const Common& common) {
  street_of(run);
  const auto* exports = as<ExportsActors>(*run.method);
  if (exports && request.format.empty())
    request.format = request.actor.empty() || fs::path(request.out).extension().empty()
                         ? "ply"
                         : std::string(splat_format(request.out).extension).substr(1);
  if (!exports && (request.format == "splat" || request.format == "spz"))
    throw Error(Fault::usage, text("--format ", request.format,
                                   ": this run has actors, not Gaussians; want glb, obj, ply or turntable"));
  const bool is_file = !request.actor.empty() && request.format != "turntable";
  is_file ? take_mesh_file(request) : check_export_folder(request);
  if (request.actor.empty()) {
    const std::vector<Exported> done = export_all(run, request, common);
    std::optional<Exported> background;
    if (exports && request.format != "turntable") background = background_file(*exports, request);
    if (done.empty() && !background) throw Error(Fault::data, "no actor of the run has a surface: nothing was written");
    tell(run.scenes, done, common, background);
    return 0;
  }
  const AssetName name = find_actor(run.scenes, log_names(run.record), request.actor);
  tell(run.scenes, {export_one(run, request, name, request.out)}, common);
  return 0;
}

constexpr std::size_t kViews = 3;  // that a file is looked at from

std::vector<float> picture(const Gaussians& gaussians, const Scene& scene, const Frame& frame) {
  const Camera camera = pinhole_around(scene.cameras[static_cast<std::size_t>(frame.camera)]);
  std::vector<float> values =
      draw(splat_model(gaussians), camera, view_matrix(frame.world_from_camera), {1e-3f}).planes.to_host();
  for (float& value : values) value = std::min(value, 1.f);
  return values;
}

/// The least of a few views.
double likeness_of(const Gaussians& written, const Gaussians& model, const Scene& scene) {
  double least = std::numeric_limits<double>::infinity();
  const std::size_t every = std::max<std::size_t>(1, scene.frames.size() / kViews);
  for (std::size_t i = 0; i < scene.frames.size(); i += every)
    least = std::min(least, psnr(picture(written, scene, scene.frames[i]), picture(model, scene, scene.frames[i])));
  return least;
}

/// Writes the file, reads it again, and prints how like the model's the pictures of what was read are.
int export_splats(const RestoredRun& run, const Gaussians& gaussians, const ExportRequest& request,
                  const Common& common) {
  const fs::path path = with_format(request.out, request.format);
  write_gaussians(path, gaussians);
  const SplatFile read = read_gaussians(path);
  for (const std::string& warning : read.warnings) warn(warning);
  const double decibel = likeness_of(turned(read.gaussians, gaussians.up), gaussians, run.scenes.front());
  if (common.json) {
    nlohmann::ordered_json json = {
        {"schema_version", 1}, {"path", path.string()}, {"gaussians", read.gaussians.count()}};
    json["psnr_to_model"] = std::isfinite(decibel) ? nlohmann::ordered_json(decibel) : nullptr;
    put_json(json);
    return 0;
  }
  const std::string same = std::isfinite(decibel) ? fmt::format("match the model at {:.1f} dB", decibel)
                                                  : std::string("equal the model's, bit for bit");
  put(text(path.string(), ": ", read.gaussians.count(), " Gaussians; read back, its renders ", same, "\n"));
  return 0;
}

/// The diffusion and the networks that it learned from, small enough to hand on.
int export_prior(const ExportRequest& request, const Common& common) {
  if (const std::string problem = problem_of(output_folder(), request.out); !problem.empty())
    throw Error(Fault::usage, "--out: " + problem);
  open_device(common);
  pack_prior(read_run(request.run), request.out);
  const std::string networks = (fs::path(request.out) / "networks").string(),
                    assets = (fs::path(request.out) / "assets").string();
  if (common.json) put_json({{"schema_version", 1}, {"networks", networks}, {"assets", assets}});
  say(common, text("the prior is ", request.out, "\n  cloam generate ", quoted(assets), " -n 16 -o generated\n  ",
                   "cloam train genassets LOG --networks ", quoted(networks), " --prior ", quoted(assets), " -o RUN"));
  return 0;
}

int run_export(const ExportRequest& request, const Common& common) {
  const RunRecord record = read_record(request.run);  // a wrong folder is told before a missing device
  if (request.format == kPrior) return export_prior(request, common);
  if (learned_from_run(record))
    throw Error(Fault::usage, text(request.run, " is a run of ", record.method,
                                   ": it has no actors and no Gaussians\n  fix: --format prior packs it for others"));
  const RestoredRun run = restored(request.run, common);
  if (request.format == kCapture) return export_capture(run, request, common);
  if (request.format == kPoints) return export_points(run, request, common);
  if (request.background) return export_background(run, request, common);
  const auto* exports = as<ExportsGaussians>(*run.method);
  if (const auto* density = as<HasDensity>(*run.method)) return export_density(run, *density, request, common);
  if (!exports) return export_actors(run, request, common);
  if (!request.actor.empty()) throw Error(Fault::usage, "--actor: this run has Gaussians, not actors");
  if (request.format == "turntable")
    throw Error(Fault::usage, "--format turntable is for actors; for Gaussians, use cloam render RUN --path orbit");
  check_file(request);
  return export_splats(run, exports->gaussians(), request, common);
}

}  // namespace

void check_file(const ExportRequest& request) {
  if (const std::string problem = problem_of(output_file(), request.out); !problem.empty())
    throw Error(Fault::usage, "--out: " + problem);
}

void take_mesh_file(ExportRequest& request) {
  check_file(request);
  const std::string extension = lower_case(fs::path(request.out).extension().string());
  if (request.format.empty() && extension.empty()) request.format = "glb";
  for (const char* known : kMeshExtensions)
    if (request.format.empty() && extension == known) request.format = extension.substr(1);
  if (request.format.empty())
    throw Error(Fault::usage,
                text("-o ", request.out, ": cannot write ", extension, "; meshes are .glb, .obj or .ply"));
  request.out = with_format(request.out, request.format).string();
}

MeshLabel run_label(const RestoredRun& run, const std::string& name) {
  MeshLabel label{name};
  label.extras = {{"method", run.record.method}, {"preset", run.record.preset},     {"seed", run.record.seed},
                  {"step", run.progress.step},   {"settings", run.record.settings}, {"version", kVersion}};
  return label;
}

Command add_export(CLI::App& program) {
  return command<ExportRequest>(
      program, "export", kExportExamples, run_export, [](const Options& add, ExportRequest& r) {
        add("RUN", r.run, "Run folder").required();
        add("-o,--out", r.out, "Output file; a folder for turntables, all actors, a prior and a capture").required();
        add("--format", r.format,
            "Surfaces and actors: glb, obj or ply (mesh); actors: turntable (PNG and GIF); Gaussians: ply, splat, spz, "
            "glb; anything: points (.ply); diffusion: prior; learned poses, lenses or boxes: capture (default: "
            "by the file's name)",
            one_of({"glb", "obj", "ply", "turntable", "splat", "spz", kPoints, kPrior, kCapture}));
        add("--actor", r.actor, "Actor to export, [LOG:]ID (all)");
        add("--background", r.background, "A street without its actors");
        add("--log", r.log, "Log that --background and points are of, by name or number (the only one)");
        add("--resolution", r.resolution, "Grid cells along the longest side of a mesh (128)", whole_number(8, 1024));
        add("--level", r.level,
            "Density of a radiance field's surface, per scene unit (that which takes half of the light over a 256th of "
            "the box)",
            number_from(1e-6, 1e9));
        add("--least-part", r.least_part,
            "Leave out loose parts of a scene's surface with less than this share of its area (0)", number_from(0, 1));
        add("--points", r.points, "Points at most, each of a ray of a training photo (1000000)",
            whole_number(1, 100000000));
        add("--farthest", r.farthest, "Distance of a point from its camera, at most (streets: 80 m)",
            number_from(1e-6, 1e9));
        add("--frames", r.frames, "Number of pictures of a turntable (36)", whole_number(1, 10000));
        add("--size", r.size, "Width and height of a turntable's pictures (256)", whole_number(16, 4096));
      });
}

}  // namespace cloam
