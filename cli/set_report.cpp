// See set_report.h.
#include "cli/set_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "cli/common.h"
#include "models/nn/inception.h"
#include "runtime/error.h"

namespace cloam {

void add_sets(nlohmann::ordered_json& json, const std::string& network, const SetDistances& sets) {
  const bool inception = network == kInception;
  const std::string kernel = inception ? "kid" : "kernel_feature_distance";
  json[inception ? "fid" : "frechet_feature_distance"] = sets.frechet;
  json[kernel] = sets.kernel.mean;
  if (sets.kernel.subsets > 1) json[kernel + "_deviation"] = sets.kernel.deviation;
  json["set_images"] = {sets.images_a, sets.images_b};
}

std::string set_lines(const std::string& network, const SetDistances& sets) {
  const std::string images = text(sets.images_a, " and ", sets.images_b, " images");
  std::string out = fmt::format("{}: {:.4g} ({})\n", feature_distance_name(network, "Frechet"), sets.frechet, images);
  out += fmt::format("{}: {:.4g}", feature_distance_name(network, "kernel"), sets.kernel.mean);
  if (sets.kernel.subsets > 1) out += fmt::format(" +- {:.2g}, {} subsets", sets.kernel.deviation, sets.kernel.subsets);
  return out + "\n";
}

void warn_of_few_images(const SetDistances& sets) {
  const int64_t fewest = std::min(sets.images_a, sets.images_b);
  if (fewest > sets.features) return;
  warn(text(fewest, " images for ", sets.features,
            " features: the Frechet distance is biased upwards; compare it only between ", "sets of equal size"));
}

}  // namespace cloam
