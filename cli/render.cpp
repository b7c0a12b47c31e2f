// cloam render: views of the capture, an orbit, or cameras from a file.
#include "cli/render.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "cli/capture.h"
#include "cli/commands.h"
#include "models/data/paths.h"
#include "models/io/gif.h"
#include "models/scene/orbit.h"
#include "models/train/camera_file.h"
#include "models/train/pictures.h"
#include "models/train/restore_run.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr int kFramesPerSecond = 20;
constexpr char kExamples[] = R"(Render views of a trained scene.

Examples:
  cloam render runs/fox -o pictures                          the held-out views
  cloam render runs/fox -o orbit --path orbit --frames 60    a turntable, with an animated GIF
  cloam render runs/fox -o all --split all --exr             colour, depth and opacity as EXR layers
  cloam render runs/fox -o one --camera cam.json)";

struct NamedView {
  std::string name;
  View view;
};

std::string numbered(const char* prefix, std::size_t index) {
  char buffer[40];
  std::snprintf(buffer, sizeof buffer, "%s_%04zu", prefix, index);
  return buffer;
}

std::vector<std::size_t> frames_of_choice(const Scene& scene, const std::string& split) {
  std::vector<std::size_t> test = frames_of(scene, Split::test), train = frames_of(scene, Split::train);
  if (split == "test" && test.empty()) warn("no view was held out: rendering the training views");
  if (split == "test") return test.empty() ? train : test;
  if (split == "all") train.insert(train.end(), test.begin(), test.end());
  return train;
}

/// Needs no images: the geometry of the run is in its folder.
std::vector<NamedView> capture_views(const RestoredRun& run, const RenderRequest& request) {
  const Scene scene = request.data.empty() ? run.scenes.front() : read_split_scene(request.data, run.record.reading);
  const std::vector<std::size_t> frames = frames_of_choice(scene, request.split);
  const std::vector<std::string> names = file_names(scene, frames);
  std::vector<NamedView> views;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const Frame& frame = scene.frames[frames[i]];
    const Camera& camera = scene.cameras[static_cast<std::size_t>(frame.camera)];
    views.push_back({names[i], view_of(frame, scaled(camera, run.record.reading.downscale), 0)});
  }
  return views;
}

std::vector<NamedView> orbit_views(const RestoredRun& run, int count) {
  const Camera& first = run.scenes.front().cameras[static_cast<std::size_t>(run.scenes.front().frames.front().camera)];
  const Camera camera = scaled(first, run.record.reading.downscale);
  std::vector<NamedView> views;
  for (const Eigen::Matrix4d& pose : orbit_poses(run.scenes.front(), count)) {
    views.push_back({numbered("orbit", views.size()), {camera, pose}});
  }
  return views;
}

std::vector<NamedView> file_views(const std::string& path) {
  std::vector<NamedView> views;
  for (const View& view : read_camera_file(path)) views.push_back({numbered("camera", views.size()), view});
  return views;
}

std::vector<NamedView> views_of(const RestoredRun& run, const RenderRequest& request) {
  if (!request.camera.empty()) return file_views(request.camera);
  if (request.path == "orbit") return orbit_views(run, request.frames);
  return capture_views(run, request);
}

void check_word(const char* option, const std::string& word, const std::vector<std::string>& known) {
  std::string list;
  for (const std::string& name : known) list += (list.empty() ? "" : ", ") + name;
  if (std::find(known.begin(), known.end(), word) != known.end()) return;
  const std::string near = nearest_name(word, known);
  throw Error(Fault::usage,
              text(option, " ", word, ": want one of ", list, near.empty() ? "" : "; did you mean " + near + "?"));
}

std::vector<Image> render_all(const RestoredRun& run, const std::vector<NamedView>& views, const RenderRequest& request,
                              const Common& common) {
  std::vector<Image> images;
  std::size_t done = 0;
  for (const auto& [name, view] : views) {
    const Picture picture = run.method->render(view);
    const Image image = to_image(picture.rgb, picture.width, picture.height);
    write_png(fs::path(request.out) / (name + ".png"), image);
    if (request.exr) write_picture_exr(fs::path(request.out) / (name + ".exr"), picture);
    if (!request.path.empty()) images.push_back(image);
    say(common, text("render ", ++done, "/", views.size(), "  ", name));
  }
  return images;
}

}  // namespace

int run_render(const RenderRequest& request, const Common& common) {
  check_word("--split", request.split, {"test", "train", "all"});
  if (!request.path.empty()) check_word("--path", request.path, {"orbit"});
  read_record(request.run);  // a wrong folder is told before a missing device
  open_device(common);
  const RestoredRun run = restore_run(request.run);
  if (!run.checkpoint.warning.empty()) warn(run.checkpoint.warning);
  const std::vector<NamedView> views = views_of(run, request);
  if (views.empty()) throw Error(Fault::data, "there is no view to render in the split " + request.split);
  const std::vector<Image> images = render_all(run, views, request, common);
  const fs::path gif = fs::path(request.out) / "orbit.gif";
  if (!images.empty()) write_gif(gif, images, kFramesPerSecond);
  if (common.json) {
    const nlohmann::ordered_json json = {{"schema_version", 1}, {"images", views.size()}, {"folder", request.out}};
    put(json.dump() + "\n");
  }
  say(common, text(views.size(), " pictures in ", request.out, images.empty() ? "" : ", turntable " + gif.string()));
  return 0;
}

Command add_render(CLI::App& program) {
  CLI::App* parser = program.add_subcommand("render", kExamples);
  const auto request = std::make_shared<RenderRequest>();
  const auto common = std::make_shared<Common>();
  parser->add_option("RUN", request->run, "Run folder")->required();
  parser->add_option("-o,--out", request->out, "Folder for the pictures")->required();
  parser->add_option("--split", request->split, "test (held-out views), train or all");
  parser->add_option("--path", request->path, "orbit: a circle around what the cameras look at");
  parser->add_option("--frames", request->frames, "Pictures of the path (60)")->check(CLI::Range(1, 10000));
  parser->add_flag("--exr", request->exr, "Also EXR: R G B A, depth.Z (along the ray), opacity.A");
  parser->add_option("--data", request->data, "Views of another capture in the same coordinates");
  parser->add_option("--camera", request->camera, "JSON with one camera or a list (as transforms.json)");
  add_common(*parser, *common);
  return {parser, [=] { return run_render(*request, *common); }};
}

}  // namespace cloam
