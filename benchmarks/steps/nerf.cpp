// Whole training steps of the radiance fields, as the trainer takes them (without saving).
#include <filesystem>
#include <memory>

#include "benchmarks/workload.h"
#include "models/data/load_images.h"
#include "models/data/read_scene.h"
#include "models/methods/registry.h"
#include "models/synth/synthetic_scene.h"
#include "models/train/capability.h"
#include "models/train/learns_from_captures.h"
#include "models/train/optimiser.h"
#include "models/train/shared_step.h"
#include "models/train/trainer.h"

namespace cloam {
namespace {

struct NerfTraining {
  std::unique_ptr<Method> method;
  std::unique_ptr<Optimiser> optimiser;
  Progress progress{0, 1000, 42};
};

std::shared_ptr<NerfTraining> begin(const char* preset_name) {
  const std::filesystem::path data = std::filesystem::temp_directory_path() / "cloam-benchmark-scene";
  if (!std::filesystem::exists(data / "transforms_test.json")) write_synthetic_scene(data, {});
  const Preset& preset = find_preset(preset_name);
  auto training = std::make_shared<NerfTraining>();
  training->method = make_method(preset.method);
  Config config;
  training->method->configure(config);
  for (const auto& [key, value] : preset.settings) config.set(key, value, "preset");
  const Scene scene = read_scene(data);
  training->method->build({scene}, 42);
  as<LearnsFromCaptures>(*training->method)->load_data({{scene, load_images(scene, Split::train)}});
  training->optimiser = std::make_unique<Optimiser>(training->method->parameters(), training->method->groups());
  return training;
}

void step(NerfTraining& training) {
  Method& method = *training.method;
  training.progress.step++;
  (void)SharedSteps().take(method, *training.optimiser, training.progress);
  method.after_step(training.progress);
}

/// `warm` steps first: the occupancy grid must settle before a step costs what it costs later.
Workload training(const char* preset, int warm, double flops) {
  return {std::string(preset) + ".step",
          flops,
          0,
          [=]() -> Run {
            auto state = begin(preset);
            for (int i = 0; i < warm; i++) step(*state);
            return [state] { step(*state); };
          },
          {}};
}

/// Multiply-adds of one sample through the frequency field (frequency_field.cpp), two operations each.
double paper_flops_per_sample() {
  const double point = 63, direction = 27, w = 256;
  return 2 * (point * w + 6 * w * w + (w + point) * w + w + w * w + (w + direction) * w / 2 + w / 2 * 3);
}

}  // namespace

void add_nerf_steps(Workloads& all) {
  all.push_back(training("nerf", 120, 0));
  all.push_back(training("nerf-paper", 1, 3 * 1024 * (64 + 192) * paper_flops_per_sample()));
}

}  // namespace cloam
