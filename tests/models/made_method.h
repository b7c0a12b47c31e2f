// Methods as tests make them: by name and settings, with data, and what they show.
#pragma once
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "models/methods/registry.h"
#include "models/scene/pixels.h"
#include "models/train/learns_from_captures.h"
#include "models/train/renders_views.h"
#include "runtime/error.h"

namespace cloam {

using Settings = std::vector<std::pair<std::string, std::string>>;

/// Of settings given twice the later one stands.
inline std::unique_ptr<Method> configured(const std::string& name, const Settings& settings) {
  auto method = make_method(name);
  Config config;
  method->configure(config);
  for (const auto& [key, value] : settings) config.set(key, value, "test");
  return method;
}

/// A hash grid that learns small made scenes in seconds.
inline Settings small_hash() {
  return {{"field.levels", "6"},    {"field.log2_rows", "13"},  {"field.finest", "128"},
          {"field.width", "32"},    {"batch.samples", "16384"}, {"batch.rays", "512"},
          {"occupancy.side", "48"}, {"march.min_step", "0.03"}, {"occupancy.cells", "16384"}};
}

/// Of one scene.
inline void load_data(Method& method, const Scene& scene, Pixels pixels) {
  std::vector<TrainingData> data;
  data.push_back({scene, std::move(pixels)});
  as<LearnsFromCaptures>(method)->load_data(std::move(data));
}

inline Picture shown(Method& method, const View& view) { return as<RendersViews>(method)->render(view); }

inline Tensor loss_of(Method& method, const Progress& progress) { return method.step(progress, {}).loss; }

/// A figure of an evaluated step.
inline double figure(const Step& step, const std::string& name) {
  for (const Figure& one : step.figures)
    if (one.name == name) return one.value();
  throw Error(Fault::internal, "no figure " + name);
}

inline void put(Method& method, const std::string& name, const std::vector<float>& values) {
  const Tensor& p = method.parameters().at(name);
  assign({{p, from_host(values, p.shape())}});
}

/// Where distances begin. Matter wherever samples are, if negative: actors fill their boxes, the background its voxels.
inline void fill(Method& method, float distance = -1) {
  std::vector<float> bias = method.parameters().at("networks.field.past.bias").to_host();
  bias[0] = distance;
  put(method, "networks.field.past.bias", bias);
}

}  // namespace cloam
