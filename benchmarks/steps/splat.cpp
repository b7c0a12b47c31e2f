// Gaussian splatting: a large capture forward and backward, and whole training steps on photographs. Without test data
// ($CLOAM_TEST_DATA) there are no such workloads.
#include <cstdlib>
#include <filesystem>
#include <memory>

#include "benchmarks/workload.h"
#include "models/data/load_images.h"
#include "models/data/read_scene.h"
#include "models/gaussians/initialise.h"
#include "models/io/npz.h"
#include "models/io/tensors.h"
#include "models/methods/registry.h"
#include "models/scene/split.h"
#include "models/splat/draw.h"
#include "models/train/capability.h"
#include "models/train/learns_from_captures.h"
#include "models/train/optimiser.h"
#include "models/train/shared_step.h"
#include "models/train/trainer.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

fs::path data_folder() {
  const char* given = std::getenv("CLOAM_TEST_DATA");
  return given ? given : "../shared/data";
}

struct Garden {
  SplatModel model;
  Camera camera;
  Tensor view;
};

std::vector<float> floats_of(const TensorMap& arrays, const char* name) {
  const std::vector<std::byte>& data = arrays.at(name).data;
  const auto* begin = reinterpret_cast<const float*>(data.data());
  return {begin, begin + data.size() / sizeof(float)};
}

/// The points of mip-NeRF 360's garden as round gaussians, by one of its three cameras.
std::shared_ptr<Garden> garden(size_t which) {
  const TensorMap arrays = read_npz(data_folder() / "gsplat_test_garden/test_garden.npz");
  PointCloud cloud;
  cloud.positions = floats_of(arrays, "means3d");
  for (const float value : floats_of(arrays, "colors")) cloud.colours.push_back(static_cast<uint8_t>(value));
  auto out = std::make_shared<Garden>();
  out->model = splat_model(gaussians_from_points(cloud));
  const std::vector<float> views = floats_of(arrays, "viewmats"), lenses = floats_of(arrays, "Ks");
  const float *view = &views[16 * which], *lens = &lenses[9 * which];
  out->view = from_host(std::vector<float>(view, view + 12), {3, 4});
  out->camera.width = static_cast<int>(floats_of(arrays, "width").front());
  out->camera.height = static_cast<int>(floats_of(arrays, "height").front());
  out->camera.fx = double{lens[0]}, out->camera.fy = double{lens[4]};
  out->camera.cx = double{lens[2]}, out->camera.cy = double{lens[5]};
  return out;
}

void add_garden(Workloads& all, size_t which) {
  const std::string name = "splat.garden." + std::to_string(which);
  all.push_back({name + ".fwd",
                 0,
                 0,
                 [=]() -> Run {
                   const auto g = garden(which);
                   return [g] { eval({draw(g->model, g->camera, g->view, {}).planes}); };
                 },
                 {}});
  all.push_back({name + ".fwdbwd",
                 0,
                 0,
                 [=]() -> Run {
                   const auto g = garden(which);
                   return [g] {
                     const SplatModel& m = g->model;
                     const Tensor half = sum(square(draw(m, g->camera, g->view, {}).planes)) * 0.5f;
                     eval(grad(half, {m.cloud.means, m.cloud.scales, m.cloud.rotations, m.cloud.opacities,
                                      m.harmonics.first, m.harmonics.rest}));
                   };
                 },
                 {}});
}

struct SplatTraining {
  std::unique_ptr<Method> method;
  std::unique_ptr<Optimiser> optimiser;
  Progress progress{0, 30000, 42};
};

/// A training step without growth, as the trainer takes it.
void step(SplatTraining& training) {
  Method& method = *training.method;
  training.progress.step++;
  (void)SharedSteps().take(method, *training.optimiser, training.progress);
}

Workload fox(int downscale, int warm, const char* size) {
  return {std::string("splat.fox.") + size + ".step",
          0,
          0,
          [=]() -> Run {
            auto training = std::make_shared<SplatTraining>();
            training->method = make_method("splat");
            Config config;
            training->method->configure(config);
            Scene scene = read_scene(data_folder() / "fox_colmap");
            apply_holdout(scene, 8);
            LoadOptions options;
            options.downscale = downscale;
            training->method->build({scene}, 42);
            as<LearnsFromCaptures>(*training->method)->load_data({{scene, load_images(scene, Split::train, options)}});
            training->optimiser =
                std::make_unique<Optimiser>(training->method->parameters(), training->method->groups());
            for (int i = 0; i < warm; i++) step(*training);
            return [training] { step(*training); };
          },
          {}};
}

}  // namespace

void add_splat_steps(Workloads& all) {
  if (fs::exists(data_folder() / "gsplat_test_garden/test_garden.npz"))
    for (const size_t which : {size_t{0}, size_t{1}, size_t{2}}) add_garden(all, which);
  if (fs::exists(data_folder() / "fox_colmap/sparse")) {
    all.push_back(fox(2, 50, "180x320"));
    all.push_back(fox(1, 50, "359x640"));
  }
}

}  // namespace cloam
