// Named, seeded parameters.
#include "models/nn/params.h"

#include <random>

#include "runtime/device.h"
#include "runtime/error.h"
#include "runtime/flat.h"

namespace cloam {
namespace {

uint64_t hash_of(const std::string& name, uint64_t seed) {
  uint64_t hash = 1469598103934665603ull ^ seed * 0x9E3779B97F4A7C15ull;
  for (unsigned char c : name) hash = (hash ^ c) * 1099511628211ull;
  return hash;
}

Tensor add(const Scope& scope, const std::string& name, const Tensor& made) {
  const std::string full = (scope / name).path;
  const Tensor value = made_to_stay(made);
  if (!scope.all.emplace(full, value).second)
    throw Error(Fault::internal, text("[params] the name ", full, " is taken"));
  return value;
}

/// Before values are made for it on the host: settings that are large together are told by the parameter they ask for.
void require_room(const Scope& scope, const std::string& name, const Shape& shape) {
  uint64_t bytes = 4 * static_cast<uint64_t>(numel(shape));
  for (const auto& [other, p] : scope.all) bytes += 4 * static_cast<uint64_t>(p.numel());
  if (bytes <= memory_budget()) return;
  throw Error(Fault::memory,
              text("the parameters up to ", (scope / name).path, " ", to_string(shape), " need ", bytes >> 20,
                   " MiB of a budget of ", memory_budget() >> 20,
                   " MiB\n  fix: smaller sizes among the settings, or --max-memory if the machine has more"));
}

}  // namespace

Tensor Scope::uniform(const std::string& name, const Shape& shape, float scale) const {
  require_room(*this, name, shape);
  std::mt19937_64 random(hash_of((*this / name).path, seed));
  std::vector<float> values(static_cast<size_t>(numel(shape)));
  // Own scaling instead of std::uniform_real_distribution, whose results differ between standard libraries.
  for (float& v : values) v = scale * (2.f * static_cast<float>(random() >> 40) * 0x1p-24f - 1.f);
  return add(*this, name, parameter(values, shape));
}

Tensor Scope::constant(const std::string& name, const Shape& shape, float value) const {
  require_room(*this, name, shape);
  return add(*this, name, parameter(std::vector<float>(static_cast<size_t>(numel(shape)), value), shape));
}

}  // namespace cloam
