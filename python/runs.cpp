// A trained run: its views rendered, its actors edited, new assets.
#include <algorithm>
#include <mutex>

#include "models/eval/asset_files.h"
#include "models/eval/pictures.h"
#include "models/io/words.h"
#include "models/runs/actor_edits.h"
#include "models/runs/actor_names.h"
#include "models/runs/edit_run.h"
#include "models/runs/version.h"
#include "models/train/renders_views.h"
#include "python/bindings.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;
using Pose = py::array_t<double, py::array::c_style | py::array::forcecast>;

/// One thread at a time uses the method: it may keep what it computed.
struct Run {
  RestoredRun restored;
  std::mutex busy;
  bool knows_source = false;  // of a run of diffusion: what it learned from is read once it generates

  explicit Run(StoredRun stored) : restored(restore_run(std::move(stored))) {
    if (!restored.checkpoint.warning.empty()) python_warning(restored.checkpoint.warning);
  }
};

using RunClass = py::class_<Run, Owned<Run>>;

struct NamedView {
  std::string name;
  View view;
};

py::array_t<double> pose_of(const NamedView& named) {
  py::array_t<double> out({4, 4});
  for (int row = 0; row < 4; ++row)
    for (int column = 0; column < 4; ++column) out.mutable_at(row, column) = named.view.world_from_camera(row, column);
  return out;
}

void set_pose(NamedView& named, const Pose& pose) {
  if (pose.ndim() != 2 || pose.shape(0) != 4 || pose.shape(1) != 4)
    throw Error(Fault::usage, "a pose is world_from_camera, [4,4]; camera axes x right, y down, z forward");
  for (int row = 0; row < 4; ++row)
    for (int column = 0; column < 4; ++column) named.view.world_from_camera(row, column) = pose.at(row, column);
}

struct Lens {
  int width, height;
  double fx, fy, cx, cy;
};

void check_size(int width, int height) {
  if (width < 1 || height < 1)
    throw Error(Fault::usage, text("a view of ", width, "x", height, " pixels: want 1 or more each way"));
}

NamedView pinhole_view(const Pose& pose, const Lens& lens, int scene, double time) {
  check_size(lens.width, lens.height);
  NamedView out{"view", {}};
  out.view.camera = {lens.width, lens.height, lens.fx, lens.fy, lens.cx, lens.cy};
  out.view.scene = scene;
  out.view.time = time;
  set_pose(out, pose);
  return out;
}

const Scene& scene_of(const Run& run, int scene) {
  const Scenes& scenes = run.restored.scenes;
  if (scene < 0 || static_cast<std::size_t>(scene) >= scenes.size())
    throw Error(Fault::usage, text("there is no scene ", scene, ": the run has ", scenes.size(), ", from 0 on"));
  return scenes[static_cast<std::size_t>(scene)];
}

/// Those of `cloam render`: at the size of the training images.
std::vector<NamedView> views_of(const Run& run, const std::string& split) {
  if (split != "test" && split != "train" && split != "all")
    throw Error(Fault::usage, text("split \"", split, "\": want test, train or all"));
  std::vector<NamedView> out;
  const RestoredRun& of = run.restored;
  check_has_views(of.record);
  for (std::size_t index = 0; index < of.scenes.size(); ++index) {
    const Scene& scene = of.scenes[index];
    std::vector<std::size_t> frames;
    for (std::size_t i = 0; i < scene.frames.size(); ++i)
      if (split == "all" || scene.frames[i].split == (split == "test" ? Split::test : Split::train))
        frames.push_back(i);
    const std::vector<std::string> names = file_names(scene, frames);
    const std::string prefix = of.scenes.size() > 1 ? log_names(of.record)[index] + "_" : "";
    for (std::size_t i = 0; i < frames.size(); ++i) {
      const Frame& frame = scene.frames[frames[i]];
      const Camera& camera = scene.cameras[static_cast<std::size_t>(frame.camera)];
      out.push_back(
          {prefix + names[i], view_of(frame, scaled(camera, of.record.reading.downscale), static_cast<int>(index))});
    }
  }
  return out;
}

Picture render(Run& run, NamedView named) {
  const std::scoped_lock lock(run.busy);
  auto* renders = as<RendersViews>(*run.restored.method);
  if (!renders) throw Error(Fault::usage, text("a run of ", run.restored.record.method, " renders no views"));
  (void)scene_of(run, named.view.scene);
  named.view.between = check_interrupt;
  return renders->render(named.view);
}

/// A run with more edits; the one that they are of stays as it is.
Owned<Run> edited(Run& run, const std::vector<std::string>& actors, const std::string& prior,
                  const MakerRequest& wish) {
  check_has_views(run.restored.record);
  StoredRun stored = [&] {
    const std::scoped_lock lock(run.busy);
    return static_cast<const StoredRun&>(run.restored);
  }();
  ActorEdits edits(
      stored,
      [&]() -> fs::path {
        if (prior.empty()) throw Error(Fault::usage, "replace=generated needs prior=RUN, a run of diffusion");
        return prior;
      },
      open_device);
  for (const std::string& words : actors) edits.apply_all(words, wish);
  return Owned<Run>(new Run(std::move(stored)));
}

int class_named(const std::string& word) {
  const std::vector<std::string> names(std::begin(kAssetClasses), std::end(kAssetClasses));
  for (std::size_t i = 0; i < names.size(); ++i)
    if (lower_case(names[i]) == lower_case(word)) return static_cast<int>(i);
  throw Error(Fault::usage, text("asset_class ", word, ": want one of ", joined(names), did_you_mean(word, names)));
}

/// What is asked for by name.
AssetRequest asset_wish(int count, const py::kwargs& options) {
  AssetRequest wish;
  wish.count = count;
  for (const auto& [key, value] : options) {
    const std::string name = py::str(key);
    if (name == "asset_class")
      wish.asset_class = class_named(py::str(value));
    else if (name == "night")
      wish.night = option_as<bool>(name, value);
    else if (name == "seed")
      wish.seed = option_as<uint64_t>(name, value);
    else if (name == "guidance")
      wish.guidance = option_as<float>(name, value);
    else if (name == "steps")
      wish.steps = option_as<int>(name, value);
    else
      throw Error(Fault::usage,
                  text("there is no ", name, " of assets: want asset_class, night, seed, guidance or steps"));
  }
  if (count < 1 || wish.steps < 1) throw Error(Fault::usage, "count and steps of assets are 1 or more");
  return wish;
}

std::vector<NewAsset> generated(Run& run, const AssetRequest& wish) {
  const std::scoped_lock lock(run.busy);
  check_is_prior(run.restored.record, run.restored.folder);
  if (!run.knows_source) load_source(run.restored);
  run.knows_source = true;
  return as<GeneratesAssets>(*run.restored.method)->generate(wish);
}

std::string write_generated(Run& run, const AssetFiles& files, const AssetRequest& wish) {
  const std::scoped_lock lock(run.busy);
  check_is_prior(run.restored.record, run.restored.folder);
  Generation made(run.restored, wish, {kVersion, "sampled"});
  return write_assets(made, files, python_listener()).dump();
}

std::map<std::string, py::array> parameters_of(Run& run) {
  std::map<std::string, py::array> out;
  for (const auto& [name, p] : run.restored.method->parameters()) {
    std::vector<float> values;
    {
      const Unlocked others;
      values = p.to_host();
    }
    out[name] = array_of(values, {p.shape().begin(), p.shape().end()});
  }
  return out;
}

std::string run_words(const Run& run) {
  const RestoredRun& r = run.restored;
  return text("<cloam.Run ", r.folder.string(), ": ", r.record.method, ", preset ", r.record.preset, ", step ",
              r.progress.step, ">");
}

void add_views(py::module_& module) {
  py::class_<NamedView>(module, "View", "What a camera is to show: where it stands, its lens, and when.")
      .def(
          py::init(
              [](const Pose& pose, int width, int height, const std::array<double, 4>& lens, int scene, double time) {
                return pinhole_view(pose, {width, height, lens[0], lens[1], lens[2], lens[3]}, scene, time);
              }),
          py::arg("pose"), py::arg("width"), py::arg("height"), py::arg("lens"), py::arg("scene") = 0,
          py::arg("time") = 0.0,
          R"(A pinhole camera: pose is world_from_camera [4,4] with camera axes x right, y down, z forward, in the run's
units; lens is (fx, fy, cx, cy) in pixels, with centres of pixels at + 0.5; time in seconds on the scene's clock.)")
      .def_readonly("name", &NamedView::name, "The name of its file, as `cloam render` has it.")
      .def_property("pose", &pose_of, &set_pose, "world_from_camera, [4,4].")
      .def_property_readonly("width", [](const NamedView& v) { return v.view.camera.width; })
      .def_property_readonly("height", [](const NamedView& v) { return v.view.camera.height; })
      .def_property_readonly("scene", [](const NamedView& v) { return v.view.scene; })
      .def_property(
          "time", [](const NamedView& v) { return v.view.time; }, [](NamedView& v, double time) { v.view.time = time; },
          "Seconds on the scene's clock: where actors are.")
      .def(
          "resized",
          [](NamedView named, int width, int height) {
            check_size(width, height);
            named.view.camera = resized(named.view.camera, width, height);
            return named;
          },
          py::arg("width"), py::arg("height"), "The same view at another size.");
  py::class_<Picture>(module, "Picture", "What a camera sees.")
      .def_property_readonly(
          "rgb",
          [](const Picture& p) {
            return array_of(p.rgb, {p.height, p.width, 3});
          },
          "[H,W,3], floats; 0 to 1 but for what a method overshoots.")
      .def_property_readonly(
          "image",
          [](const Picture& p) {
            return array_of(to_image(p.rgb, p.width, p.height).pixels, {p.height, p.width, 3});
          },
          "[H,W,3], bytes: the pixels of the PNG that `cloam render` writes.")
      .def_property_readonly(
          "depth",
          [](const Picture& p) {
            return array_of(p.depth, {p.height, p.width});
          },
          "[H,W], along the ray, in scene units; 0: nothing.")
      .def_property_readonly(
          "opacity",
          [](const Picture& p) {
            return array_of(p.opacity, {p.height, p.width});
          },
          "[H,W].")
      .def_property_readonly(
          "actors",
          [](const Picture& p) -> py::object {
            if (p.actors.empty()) return py::none();
            return array_of(p.actors, {p.height, p.width});
          },
          "[H,W], 1 + the place of the actor that is seen in its scene's actors, 0: none. None of methods without.");
}

void add_run_class(RunClass& run) {
  run.def("__repr__", &run_words)
      .def_property_readonly("folder", [](const Run& r) { return r.restored.folder; })
      .def_property_readonly("method", [](const Run& r) { return r.restored.record.method; })
      .def_property_readonly("preset", [](const Run& r) { return r.restored.record.preset; })
      .def_property_readonly("step", [](const Run& r) { return r.restored.progress.step; })
      .def_property_readonly("settings", [](const Run& r) { return r.restored.record.settings; })
      .def(
          "actors",
          [](const Run& r, int scene) {
            std::vector<std::string> ids;
            for (const Actor& actor : scene_of(r, scene).actors) ids.push_back(actor.id);
            return ids;
          },
          py::arg("scene") = 0, "The ids of a scene's actors.")
      .def("parameters", &parameters_of, "All parameters by name, as arrays of their own.")
      .def("views", &views_of, py::arg("split") = "test",
           "The capture's views of a split: test (held out), train or all.")
      .def("render", &render, py::arg("view"), py::call_guard<Unlocked>())
      .def(
          "edit",
          [](Run& r, const std::vector<std::string>& actors, const std::string& prior, uint64_t seed, float guidance) {
            return edited(r, actors, prior, {seed, guidance});
          },
          py::arg("actors"), py::arg("prior") = "", py::arg("seed") = 0, py::arg("guidance") = 1.f,
          py::call_guard<Unlocked>(),
          R"(A run with its actors edited, by the words that `cloam edit --actor` takes: "3f2a:shift=2,0,0,rotate=90".

prior: the folder of a run of diffusion, for replace=generated. Nothing is written until save().)")
      .def(
          "save",
          [](Run& r, const fs::path& folder) {
            const std::scoped_lock lock(r.busy);
            write_edited_run(r.restored, folder, "cloam.Run.save of Python");
          },
          py::arg("folder"), py::call_guard<Unlocked>(),
          "Writes an edited run into a new folder, as `cloam edit` does.");
}

void add_generation(py::module_& module, RunClass& run) {
  py::class_<NewAsset>(module, "Asset", "A generated asset: its latent code and the box that it fills.")
      .def_property_readonly("asset_class", [](const NewAsset& a) { return std::string(kAssetClasses[a.asset_class]); })
      .def_readonly("night", &NewAsset::night)
      .def_property_readonly(
          "size",
          [](const NewAsset& a) {
            return std::array{a.size.x(), a.size.y(), a.size.z()};
          },
          "Metres: width, length, height.")
      .def_property_readonly(
          "code", [](const NewAsset& a) { return array_of(a.code, {static_cast<py::ssize_t>(a.code.size())}); });
  run.def(
         "generate",
         [](Run& r, int count, const py::kwargs& options) {
           const AssetRequest wish = asset_wish(count, options);
           const Unlocked others;
           return generated(r, wish);
         },
         py::arg("count") = 1,
         R"(New assets of a run of diffusion.

asset_class: a word such as "Car", and night: True or False; without them as often as in training. seed: the same gives
the same. guidance: above 1 follows class and night more closely. steps: of denoising.)")
      .def(
          "write_assets",
          [](Run& r, const fs::path& folder, int count, bool meshes, const py::kwargs& options) {
            const AssetRequest wish = asset_wish(count, options);
            AssetFiles files;
            files.folder = folder;
            files.meshes = meshes;
            const Unlocked others;
            return write_generated(r, files, wish);
          },
          py::arg("folder"), py::arg("count") = 1, py::arg("meshes") = true,
          "Writes the files of `cloam generate`; gives the text of generate.json. The rest as generate() takes it.");
}

}  // namespace

void add_runs(py::module_& module) {
  add_views(module);
  RunClass run(module, "Run", "A trained run, with its model on the device: load() gives one.");
  add_run_class(run);
  add_generation(module, run);
  module.def(
      "load",
      [](const fs::path& folder) {
        StoredRun stored = read_run(folder);  // a wrong folder is told before a missing device
        open_device();
        return Owned<Run>(new Run(std::move(stored)));
      },
      py::arg("run"), py::call_guard<Unlocked>(), "The run in a folder, from its newest whole checkpoint.");
}

}  // namespace cloam
