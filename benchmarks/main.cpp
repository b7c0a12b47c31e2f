// cloam-benchmarks [ops|steps]: the device's limits, then the op rows that name a benchmark size, then whole training
// steps of the presets, each with its share of the measured peak. Run it on an otherwise idle machine.
#include <chrono>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <functional>

#include "models/data/read_scene.h"
#include "models/data/synthetic_scene.h"
#include "models/methods/registry.h"
#include "models/train/optimiser.h"
#include "runtime/device.h"
#include "runtime/error.h"
#include "runtime/limits.h"
#include "tests/op_cases/op_cases.h"

namespace cloam {
namespace {

double median_ms(int rounds, const std::function<void()>& work) {
  std::vector<double> times;
  for (int i = 0; i < rounds; i++) {
    synchronize();
    const auto start = std::chrono::steady_clock::now();
    work();
    synchronize();
    times.push_back(std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count());
  }
  std::sort(times.begin(), times.end());
  return times[times.size() / 2];
}

void bench_ops(const DeviceLimits& limits) {
  std::printf("%-44s %10s %10s %7s\n", "op (forward)", "ms", "GFLOP/s", "share");
  for (const OpCase& row : op_cases()) {
    if (row.bench.empty()) continue;
    const Tensors in = make_inputs(row, row.bench);
    eval({row.run(in)});
    const double ms = median_ms(9, [&] { eval({row.run(in)}); });
    const double gflops = row.bench_flops / ms * 1e-6;
    std::printf("%-44s %10.3f %10.1f %6.0f%%\n", row.name().c_str(), ms, gflops, 100 * gflops / limits.gflops);
  }
}

/// Multiply-adds of one sample through the frequency field (frequency_field.cpp), two operations each.
double paper_flops_per_sample() {
  const double point = 63, direction = 27, w = 256;
  return 2 * (point * w + 6 * w * w + (w + point) * w + w + w * w + (w + direction) * w / 2 + w / 2 * 3);
}

struct StepCost {
  double ms = 0, host_share = 0, launches = 0;
};

StepCost time_steps(const char* preset_name, const std::filesystem::path& data, int warm, int timed) {
  const Preset& preset = find_preset(preset_name);
  const std::unique_ptr<Method> method = make_method(preset.method);
  Config config;
  method->configure(config);
  for (const auto& [key, value] : preset.settings) config.set(key, value, "preset");
  const Scene scene = read_scene(data);
  method->build(scene, 42);
  method->load_data({scene, load_images(scene, Split::train)});
  Optimiser optimiser(method->parameters(), method->learning_rates({}));
  Progress progress{0, 1000, 42};
  const auto step = [&] {
    progress.step++;
    Tensors wanted;
    for (const auto& [name, p] : method->parameters()) wanted.push_back(p);
    const Tensor loss = method->loss(progress);
    Tensors all = grad(loss, wanted);
    all.push_back(loss);
    eval(all);
    all.pop_back();
    optimiser.step(method->parameters(), all, method->learning_rates(progress), method->adam(), progress.step);
    (void)loss.item();
    method->after_step(progress);
  };
  for (int i = 0; i < warm; i++) step();
  const DeviceStats before = device_stats();
  const auto start = std::chrono::steady_clock::now();
  StepCost cost;
  cost.ms = median_ms(timed, step);
  const double wall = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  cost.host_share = 1 - (device_stats().wait_seconds - before.wait_seconds) / wall;
  cost.launches = static_cast<double>(device_stats().launches - before.launches) / timed;
  return cost;
}

void bench_steps(const DeviceLimits& limits) {
  const std::filesystem::path data = std::filesystem::temp_directory_path() / "cloam-benchmark-scene";
  if (!std::filesystem::exists(data / "transforms_test.json")) write_synthetic_scene(data, {});
  const StepCost fast = time_steps("nerf", data, 120, 60);
  std::printf("step nerf        %9.1f ms  host %4.1f %%  %.0f launches\n", fast.ms, 100 * fast.host_share,
              fast.launches);
  const StepCost paper = time_steps("nerf-paper", data, 1, 3);
  const double flops = 3 * 1024 * (64 + 192) * paper_flops_per_sample();
  std::printf(
      "step nerf-paper  %9.1f ms  host %4.1f %%  %.0f launches  %.2f TFLOP  %.0f GFLOP/s = %.0f %% of the measured "
      "peak\n",
      paper.ms, 100 * paper.host_share, paper.launches, flops * 1e-12, flops / paper.ms * 1e-6,
      100 * flops / paper.ms * 1e-6 / limits.gflops);
}

int run(int count, char** words) {
  const DeviceLimits limits = measure_limits();
  std::printf("%s (%s)\npeak %.0f GFLOP/s fp32, copy %.0f GB/s, launch %.1f us\n", device().name.c_str(),
              device().driver.c_str(), limits.gflops, limits.copy_gbps, limits.launch_us);
  if (count < 2 || std::strcmp(words[1], "ops") == 0) bench_ops(limits);
  if (count < 2 || std::strcmp(words[1], "steps") == 0) bench_steps(limits);
  return 0;
}

}  // namespace
}  // namespace cloam

int main(int count, char** words) {
  try {
    return cloam::run(count, words);
  } catch (const cloam::Error& e) {
    std::fprintf(stderr, "error: %s\n", e.what());
    return static_cast<int>(e.fault());
  }
}
