// cloam render: views of the capture, a path, or cameras from a file.
#include <algorithm>
#include <nlohmann/json.hpp>

#include "cli/child_program.h"
#include "cli/commands.h"
#include "cli/ranks.h"
#include "cli/render_views.h"
#include "cli/stop_signal.h"
#include "cli/terminal_picture.h"
#include "models/eval/ellipsoid_views.h"
#include "models/eval/geometry_pictures.h"
#include "models/eval/pictures.h"
#include "models/eval/sample_pictures.h"
#include "models/io/commit.h"
#include "models/io/gif.h"
#include "models/io/ply.h"
#include "models/io/words.h"
#include "models/runs/actor_names.h"
#include "models/runs/captures.h"
#include "models/runs/shared_work.h"
#include "models/street/lidar_rays.h"
#include "models/train/renders_views.h"
#include "models/train/shows_samples.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr int kFilmRate = 20;
constexpr char kEllipsoids[] = "ellipsoids", kSamples[] = "samples";
constexpr char kRenderExamples[] = R"(Render views of a trained scene.

Examples:
  cloam render runs/fox -o pictures                          the held-out views
  cloam render runs/fox -o orbit --path orbit --frames 60    a turntable, with a GIF and an MP4 (H.264)
  cloam render runs/fox -o walk --path interpolated --frames 200    through the cameras, likewise
  cloam render runs/fox -o all --split all --exr             colour, depth, normals, opacity as EXR layers
  cloam render runs/fox -o depths --draw depth               or normals, opacity, ellipsoids, samples
  cloam render runs/fox -o one --camera cam.json
  cloam render runs/street -o wide --log 003 --time +0.75 --camera-name left_camera --size 1280x720
  cloam render runs/street -o sweeps --lidar --split all)";

/// NAME_actor.png as the truth beside logs has it: which actor each pixel shows, 1 + its place in actors.json.
void write_mask(const fs::path& path, const Picture& picture) {
  Labels labels{picture.width, picture.height, {}};
  for (const int actor : picture.actors) labels.values.push_back(static_cast<std::uint16_t>(actor));
  write_labels(path, labels);
}

void write_actor_names(const RestoredRun& run, const RenderRequest& request) {
  for (const int index : scenes_asked_for(run, request)) {
    nlohmann::ordered_json json = nlohmann::ordered_json::object();
    const Scene& scene = run.scenes[static_cast<std::size_t>(index)];
    for (std::size_t i = 0; i < scene.actors.size(); ++i) json[std::to_string(i + 1)] = scene.actors[i].id;
    const std::string prefix =
        run.scenes.size() > 1 ? log_names(run.record)[static_cast<std::size_t>(index)] + "_" : "";
    commit_text(fs::path(request.out) / (prefix + "actors.json"), json.dump(1) + "\n");
  }
}

/// What the pictures are called that make a film together, as NAME_0000; none where each stands for itself.
std::string film_name(const std::vector<NamedView>& views, const RenderRequest& request) {
  if (!request.path.empty()) return request.path;
  const auto other_size = [&](const NamedView& v) {
    return v.view.camera.width != views.front().view.camera.width ||
           v.view.camera.height != views.front().view.camera.height;
  };
  if (request.camera.empty() || views.size() < 2 || std::any_of(views.begin(), views.end(), other_size)) return "";
  return kCameraFileViews;
}

Image drawn(const Picture& picture, const View& view, const std::string& what) {
  if (what == "depth") return depth_picture(picture);
  if (what == "normals") return normal_picture(picture, view.camera);
  if (what == "opacity") return opacity_picture(picture);
  return to_image(picture.rgb, picture.width, picture.height);
}

void render_view(const RestoredRun& run, const NamedView& view, const RenderRequest& request) {
  const fs::path folder = request.out;
  if (request.draw == kSamples) {
    const Camera& camera = view.view.camera;
    const auto samples = as<ShowsSamples>(*run.method)->samples(view.view, camera.height / 2);
    write_png(folder / (view.name + ".png"), sample_picture(samples, camera.width, camera.height));
    return;
  }
  const Picture picture =
      request.draw == kEllipsoids ? ellipsoids_seen(run, view.view) : as<RendersViews>(*run.method)->render(view.view);
  write_png(folder / (view.name + ".png"), drawn(picture, view.view, request.draw));
  if (request.exr) write_picture_exr(folder / (view.name + ".exr"), picture, view.view);
  if (request.masks) write_mask(folder / (view.name + "_actor.png"), picture);
}

void render_all(const RestoredRun& run, const std::vector<NamedView>& views, const RenderRequest& request,
                const Common& common) {
  const StopOnSignal signals("finishing this picture");
  const auto make = [&](std::size_t item) {
    render_view(run, views[item], request);
    say(common, text("render ", item + 1, "/", views.size(), "  ", views[item].name));
    return nullptr;
  };
  const auto complete = [&](std::size_t done) {
    return text(done, " of ", views.size(), " pictures are complete in ", request.out);
  };
  share_out(ranks(), listener_of(common), {views.size(), make, complete});
}

[[noreturn]] void nothing_to_render(const char* what, const RestoredRun& run, const RenderRequest& request) {
  if (!request.step) throw Error(Fault::data, text("no ", what, " to render in the split ", request.split));
  int last = -1;
  for (const Scene& scene : run.scenes)
    for (const Frame& frame : scene.frames) last = std::max(last, scene.is_log ? frame.step : -1);
  throw Error(Fault::usage,
              last < 0 ? text("--step ", *request.step, ": the run has photos; driving logs have steps")
                       : text("--step ", *request.step, ": no ", what, " of that step; the last step is ", last));
}

/// The sweep that the model would return along the recorded rays.
void render_sweep(Street& street, const SweepRays& sweep, const fs::path& path) {
  const LidarReturns seen = street.measure(sweep.rays);
  std::vector<PlyColumn> columns = {{"x", {}}, {"y", {}}, {"z", {}}, {"actor", {}}};
  for (std::size_t i = 0; i < seen.depths.size(); ++i) {
    if (seen.depths[i] <= 0) continue;
    for (std::size_t axis = 0; axis < 3; ++axis)
      columns[axis].values.push_back(sweep.rays.origins[3 * i + axis] +
                                     seen.depths[i] * sweep.rays.directions[3 * i + axis]);
    columns[3].values.push_back(static_cast<float>(seen.actors[i]));
  }
  const auto add = [&](const char* name, const std::vector<float>& of_rays) {
    if (of_rays.empty()) return;  // the method does not know them
    columns.push_back({name, {}});
    for (std::size_t i = 0; i < of_rays.size(); ++i)
      if (seen.depths[i] > 0) columns.back().values.push_back(of_rays[i]);
  };
  add("intensity", seen.intensities);
  add("drop", seen.drops);
  write_ply_vertices(path, columns);
}

/// Those of the split, or of the step.
std::vector<const Sweep*> sweeps_asked_for(const Scene& scene, const RenderRequest& request) {
  std::vector<const Sweep*> sweeps;
  for (const Sweep& sweep : scene.sweeps) {
    const bool in_split = request.split == "all" || (sweep.split == Split::test) == (request.split == "test");
    if (request.step ? sweep.step == *request.step : in_split) sweeps.push_back(&sweep);
  }
  return sweeps;
}

/// The sweeps of the split or step. Only their directions are read from the data.
std::size_t render_lidar(const RestoredRun& run, const RenderRequest& request, const Common& common) {
  std::size_t before = 0;  // in the logs before
  const StopOnSignal signals("finishing this sweep");
  for (const int index : scenes_asked_for(run, request)) {
    const RunData& data = run.record.data[static_cast<std::size_t>(index)];
    const fs::path folder = request.data.empty() ? find_data(request.run, data) : fs::path(request.data);
    const Scene scene = read_split_scene(folder, reading_for(run.record, !request.data.empty(), request.allow_outside));
    const std::vector<const Sweep*> sweeps = sweeps_asked_for(scene, request);
    const std::string prefix =
        run.scenes.size() > 1 ? log_names(run.record)[static_cast<std::size_t>(index)] + "_" : "";
    const auto make = [&](std::size_t item) {
      const Sweep& sweep = *sweeps[item];
      const std::string name = prefix + "lidar_" + fs::path(sweep.file).stem().stem().string() + ".ply";
      render_sweep(street_of(run), sweep_rays(sweep, load_sweep(scene, sweep), index), fs::path(request.out) / name);
      say(common, text("render ", before + item + 1, "  ", name));
      return nullptr;
    };
    const auto complete = [&](std::size_t done) {
      return text(before + done, " sweeps are complete in ", request.out);
    };
    share_out(ranks(), listener_of(common), {sweeps.size(), make, complete});
    before += sweeps.size();
  }
  if (before == 0) nothing_to_render("sweep", run, request);
  return before;
}

int render_lidar_alone(const RestoredRun& run, const RenderRequest& request, const Common& common) {
  const std::size_t sweeps = render_lidar(run, request, common);
  if (common.json) put_json({{"schema_version", 1}, {"sweeps", sweeps}, {"folder", request.out}});
  say(common, text(sweeps, " sweeps in ", request.out));
  return 0;
}

// Left alone, ffmpeg converts to BT.601 and does not say so, and players take large films for BT.709.
constexpr char kFilter[] = "crop=trunc(iw/2)*2:trunc(ih/2)*2:0:0,scale=out_color_matrix=bt709,format=yuv420p";

/// For ffmpeg, which reads % as the beginning of a number's place.
std::string without_places(const std::string& path) {
  std::string out;
  for (const char letter : path) out += letter == '%' ? "%%" : std::string(1, letter);
  return out;
}

/// Paths begin with a slash: ffmpeg takes what stands before a colon for a protocol.
void encode(const fs::path& ffmpeg, const std::vector<std::string>& input, const fs::path& film) {
  std::vector<std::string> words = {"-nostdin", "-hide_banner", "-loglevel", "error", "-xerror", "-y"};
  words.insert(words.end(), input.begin(), input.end());
  for (const char* word : {"-c:v", "libx264", "-vf", kFilter, "-colorspace", "bt709", "-color_primaries", "bt709",
                           "-color_trc", "iec61966-2-1", "-movflags", "+faststart"})
    words.push_back(word);
  words.push_back(film.string());
  const ChildEnd end = run_child({ffmpeg, words});
  if (end.code == 0) return;
  if (end.is_of_full_disk())
    throw Error(Fault::write,
                text("cannot write the video: ", space_advice(film.parent_path()), "; ffmpeg printed:", end.said));
  throw Error(Fault::data, ffmpeg.string() + " " + end.in_words());
}

/// FOLDER/NAME.mp4 of the pictures FOLDER/NAME_0000.png to `count`, of even width and height: an odd last column or row
/// is left out. False where ffmpeg is not in PATH (a line says so) and where it fails (a warning with its last words);
/// Fault::write where the disk is full.
bool write_film(const fs::path& folder, const std::string& name, std::size_t count, int frames_per_second,
                const Common& common) {
  const fs::path ffmpeg = find_program("ffmpeg"), film = folder / (name + ".mp4");
  if (ffmpeg.empty()) {
    say(common, text("no ", film.string(), ": ffmpeg is not in PATH (apt-get install ffmpeg)"));
    return false;
  }
  const std::string pictures = without_places(fs::absolute(folder / name).string()) + "_%04d.png";
  try {
    commit_file(fs::absolute(film), [&](const fs::path& temp) {
      encode(ffmpeg,
             {"-f", "image2", "-pattern_type", "sequence", "-framerate", std::to_string(frames_per_second),
              "-start_number", "0", "-i", pictures, "-frames:v", std::to_string(count)},
             temp);
    });
  } catch (const Error& error) {
    if (error.fault() == Fault::write) throw;
    warn(text("no ", film.string(), ": ", error.what()));
    return false;
  }
  return true;
}

/// The pictures of `views`, which are on the disk, as a GIF and a film where they belong together. Returns in words
/// what was made.
std::string write_moving(const std::vector<NamedView>& views, const RenderRequest& request, const Common& common) {
  const std::string name = film_name(views, request);
  if (name.empty()) return "";
  const fs::path folder = request.out, gif = folder / (name + ".gif");
  std::vector<Image> images;
  for (const NamedView& view : views) images.push_back(read_image(folder / (view.name + ".png")));
  write_gif(gif, images, kFilmRate);
  const bool film = write_film(folder, name, images.size(), kFilmRate, common);
  return ", " + gif.string() + (film ? " and " + name + ".mp4" : "");
}

void check_request(const RenderRequest& request) {
  if (!request.path.empty() && !request.camera.empty())
    throw Error(Fault::usage, "give either --path or --camera, not both");
  if (request.step && !request.time.empty()) throw Error(Fault::usage, "give either --step or --time, not both");
  if (request.lidar && (!request.camera.empty() || !request.path.empty() || !request.time.empty()))
    throw Error(Fault::usage, "--lidar renders recorded sweeps: choose them with --split, --step and --log");
  if (request.draw == kEllipsoids && request.masks)
    throw Error(Fault::usage, "--masks are of the rendered picture: leave out --draw ellipsoids");
  if (request.draw == kSamples && (request.masks || request.exr))
    throw Error(Fault::usage, "--masks and --exr are of the rendered picture: leave out --draw samples");
}

int run_render(const RenderRequest& request, const Common& common) {
  check_request(request);
  check_has_views(read_record(request.run));  // a wrong folder is told before a missing device
  const RestoredRun run = restored(request.run, common);
  if ((request.masks || request.lidar) && !as<Street>(*run.method))
    throw Error(Fault::usage,
                text("--masks and --lidar need a method with actors and LiDAR; the run's is ", run.record.method));
  if (request.draw == kEllipsoids && !has_ellipsoids(run))
    throw Error(Fault::usage,
                text("--draw ellipsoids shows the Gaussians of a run of splat or street-gaussians; the run's "
                     "method is ",
                     run.record.method));
  if (request.draw == kSamples && !as<ShowsSamples>(*run.method))
    throw Error(Fault::usage, text("--draw samples shows where a run of nerf samples its rays; the run's method is ",
                                   run.record.method));
  if (request.lidar) return render_lidar_alone(run, request, common);
  const std::vector<NamedView> views = views_of(run, request);
  if (views.empty()) nothing_to_render("view", run, request);
  render_all(run, views, request, common);
  if (ranks().rank() > 0) return 0;
  if (request.masks) write_actor_names(run, request);
  const std::string moving = write_moving(views, request, common);
  if (common.json) put_json({{"schema_version", 1}, {"images", views.size()}, {"folder", request.out}});
  say(common, text(views.size(), " pictures in ", request.out, moving));
  show_picture(request.show, fs::path(request.out) / (views.front().name + ".png"), common);
  return 0;
}

}  // namespace

Command add_render(CLI::App& program) {
  return command<RenderRequest>(
      program, "render", kRenderExamples, run_render, [](const Options& add, RenderRequest& r) {
        add("RUN", r.run, "Run folder").required();
        add("-o,--out", r.out, "Folder for the pictures").required();
        add("--split", r.split, "test (held-out views), train or all (test)", one_of({"test", "train", "all"}));
        add("--path", r.path, "orbit: a circle around what the cameras look at; interpolated: from camera to camera",
            one_of({"orbit", "interpolated"}));
        add("--frames", r.frames, "Number of pictures along the path (60)", whole_number(1, 10000));
        add("--log", r.log, "Runs on several logs: number (from 0) or name of one log");
        add("--camera-name", r.camera_name, "Driving logs: only this camera, such as front_camera");
        add("--step", r.step, "Driving logs: only this step, whatever the split", whole_number(0));
        add("--time", r.time,
            "Driving logs: one camera at this time (seconds of the log, or +1.5 after its first image)");
        add("--size", r.size, "Picture size, WIDTHxHEIGHT (that of the training images)");
        add("--draw", r.draw,
            "What the pictures show: colour, depth, normals, opacity, ellipsoids (Gaussians), samples (nerf) (colour)",
            one_of({"colour", "depth", "normals", "opacity", kEllipsoids, kSamples}));
        add("--masks", r.masks, "Also write which actor each pixel shows (NAME_actor.png, actors.json)");
        add("--lidar", r.lidar, "Render LiDAR sweeps along the recorded rays, as PLY, instead of pictures");
        add("--exr", r.exr,
            "Also write EXR: R G B A, Z (depth along the optical axis), N.X N.Y N.Z (normal), depth.Z (along the ray), "
            "opacity.A");
        add("--data", r.data, "Render the views of another capture in the same coordinates");
        add_allow_outside(add, r.allow_outside);
        add_show(add, r.show);
        add("--camera", r.camera, "Cameras from a JSON file like transforms.json; several also make a GIF and an MP4");
      });
}

}  // namespace cloam
