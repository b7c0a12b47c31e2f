// How far rounding and another device carry a training: the same steps in float64 on the device (CLOAM_DEBUG=float64),
// which draws the same batches. Distances are those of all parameters, in parts of the way that the float64 training
// went. The suite takes two steps; CLOAM_TRAJECTORIES=all (script/trajectories) takes up to 200.
#include <doctest/doctest.h>

#include <cmath>
#include <cstdlib>
#include <cstring>

#include "models/io/safetensors.h"
#include "tests/cli/small_trainings.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

struct Device {
  const char* name;
  fs::path driver;  // a file; without it the device is not installed
  Words environment;
  int steps;
};

const fs::path kDrivers = "/etc/OpenCL/vendors";
const Words kPocl = {"OCL_ICD_VENDORS=pocl.icd"}, kFloat64 = {"OCL_ICD_VENDORS=pocl.icd", "CLOAM_DEBUG=float64"};

/// genassets is chaotic: trainings that differ in the last bit of a double are 1e-13 of the way apart after 50 steps,
/// and 0.06 of it after 200 (docs/rounding.md). The suite leaves PoCL as a GPU out where rusticl is there, which runs
/// those kernels, too.
std::vector<Device> devices(const std::string& method) {
  const bool all = std::getenv("CLOAM_TRAJECTORIES") != nullptr;
  const int many = method == "genassets" ? 20 : 200;
  const Device pocl = {"PoCL", kDrivers / "pocl.icd", kPocl, all ? many : 2},
               as_gpu = {"PoCL, kernels of GPUs",
                         kDrivers / "pocl.icd",
                         {kPocl[0], "CLOAM_DEVICE_CLASS=gpu"},
                         all ? many : 2},
               rusticl = {"rusticl",
                          kDrivers / "rusticl.icd",
                          {"OCL_ICD_VENDORS=rusticl.icd", "RUSTICL_ENABLE=llvmpipe", "CLOAM_DEVICE=llvmpipe"},
                          all ? 20 : 2};
  if (!all && fs::exists(rusticl.driver)) return {pocl, rusticl};
  return {pocl, as_gpu, rusticl};
}

fs::path fresh(const std::string& method) {
  static int made = 0;
  return scratch() / (method + "-trajectory" + std::to_string(made++));
}

/// "param." alone: what a training is for.
TensorMap parameters_of(const fs::path& run) {
  std::string name = content_of(run / "ckpt" / "latest.txt");
  while (!name.empty() && name.back() == '\n') name.pop_back();
  TensorMap out;
  for (auto& [key, tensor] : read_safetensors(run / "ckpt" / name).tensors)
    if (key.starts_with("param.") && tensor.dtype == "F32") out[key] = tensor;
  return out;
}

TensorMap trained(const SmallTraining& training, int steps, int seed, const Words& environment) {
  const fs::path run = fresh(training.method);
  Words more = {"--steps", std::to_string(steps), "--seed", std::to_string(seed)};
  // Gaussians are born where a gradient is above a threshold: one of them more, and there is no distance to measure.
  const std::string method = training.method;
  if (method == "splat" || method == "street-gaussians") more.insert(more.end(), {"--set", "growth.start=100000"});
  const Outcome outcome = cloam_with(training.words(run, more), environment);
  REQUIRE_MESSAGE(outcome.code == 0, training.method, ": ", outcome.err);
  TensorMap out = parameters_of(run);
  fs::remove_all(run);
  return out;
}

double distance(const TensorMap& a, const TensorMap& b) {
  double total = 0;
  for (const auto& [name, left] : a) {
    const NamedTensor& right = b.at(name);
    REQUIRE(left.shape == right.shape);
    std::vector<float> x(left.data.size() / 4), y(x.size());
    std::memcpy(x.data(), left.data.data(), left.data.size());
    std::memcpy(y.data(), right.data.data(), right.data.size());
    for (size_t i = 0; i < x.size(); i++) total += (double{x[i]} - y[i]) * (double{x[i]} - y[i]);
  }
  return std::sqrt(total);
}

/// The float64 training of so many steps, and how far it went since the first.
struct Reference {
  Reference(const SmallTraining& training, int steps, int seed)
      : end(trained(training, steps, seed, kFloat64)), way(distance(trained(training, 1, seed, kFloat64), end)) {}
  TensorMap end;
  double way;
};

}  // namespace

TEST_CASE("trajectories: each device stays near the training in float64") {
  constexpr int kSeed = 7;
  for (const SmallTraining& training : small_trainings()) {
    const std::string method = training.method;
    std::map<int, Reference> references;
    for (const Device& device : devices(method)) {
      if (!fs::exists(device.driver)) continue;
      if (!references.contains(device.steps))
        references.emplace(device.steps, Reference(training, device.steps, kSeed));
      const Reference& reference = references.at(device.steps);
      const double away = distance(trained(training, device.steps, kSeed, device.environment), reference.end);
      MESSAGE(method, ", ", device.steps, " steps, ", std::string(device.name), ": ", away / reference.way,
              " of the way");
      CHECK(away < 0.2 * reference.way);
    }
  }
}
