// See lpips.h.
#include "models/metrics/lpips.h"

#include <algorithm>
#include <filesystem>

#include "runtime/error.h"

namespace cloam {
namespace {

/// PerceptualSimilarity adds to the length, not to its square: channels that are all 0 stay 0.
/// A product by the inverse, since NVIDIA's compiler fuses the last product within a division with a difference that
/// follows, whatever FP_CONTRACT says: a picture's distance to itself would not be 0.
Tensor of_unit_length(const Tensor& map) { return map * (1.f / (sqrt(sum(square(map), {{1}, true})) + 1e-10f)); }

const char* linear_name(const std::string& network) { return network == kAlexNet ? kLpipsAlex : kLpipsVgg; }

/// Of the layer after each tap.
Tensors linear_layers(const Weights& from, const std::vector<int64_t>& channels) {
  Tensors layers;
  for (size_t i = 0; i < channels.size(); i++) {
    const std::string name = text("lin", i, ".model.1.weight");
    const std::vector<float> values = from.take(name, {1, channels[i], 1, 1});
    if (std::any_of(values.begin(), values.end(), [](float value) { return value < 0; }))
      bad_data(from.file.string(), ": ", name, " has values below 0: they are no weights of LPIPS");
    layers.push_back(from_host(values, {1, channels[i], 1, 1}));
  }
  return layers;
}

}  // namespace

Tensor Lpips::operator()(const Tensor& a, const Tensor& b) const {
  match("lpips", {{"a", a, "N 3 H W"}, {"b", b, "N 3 H W"}});
  const Tensors of_a = network(a), of_b = network(b);
  Tensor total = 0.f;
  for (size_t i = 0; i < weights.size(); i++)
    total = total + mean(sum(weights[i] * square(of_unit_length(of_a[i]) - of_unit_length(of_b[i])), {{1}}), {{1, 2}});
  return total;
}

bool Lpips::published() const { return lpips_key(name) == "lpips"; }

std::string lpips_key(const std::string& name) {
  return name == kLpipsAlex || name == kLpipsVgg ? "lpips" : "perceptual_distance";
}

Lpips lpips(const Weights& backbone, const Weights& linear) {
  FeatureNetwork network = feature_network(backbone);
  if (network.name != kAlexNet && network.name != kVgg16)
    bad_data(backbone.file.string(), ": LPIPS is defined by AlexNet or VGG-16, found ", network.name);
  const std::string name = linear_name(network.name);
  const bool published = is_published(network.name, backbone.sha256) && is_published(name, linear.sha256);
  const auto channels = network.name == kAlexNet ? std::vector<int64_t>{64, 192, 384, 256, 256}
                                                 : std::vector<int64_t>{64, 128, 256, 512, 512};
  return {name_by_weights(name, published), std::move(network), linear_layers(linear, channels)};
}

Lpips lpips_named(const std::string& files) {
  const size_t comma = files.rfind(',');
  if (comma == std::string::npos || std::filesystem::exists(files)) {
    const Weights both = read_weights(files);
    return lpips(both, both);
  }
  return lpips(read_weights(files.substr(0, comma)), read_weights(files.substr(comma + 1)));
}

}  // namespace cloam
