// The distances of two sets of images as reports have them. Keys are documented in docs/formats.md.
#pragma once
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "models/metrics/feature_distance.h"

namespace cloam {

/// fid and kid of Inception's features, frechet_feature_distance and kernel_feature_distance of other networks'.
void add_sets(nlohmann::ordered_json& json, const std::string& network, const SetDistances& sets);
/// A line each.
std::string set_lines(const std::string& network, const SetDistances& sets);
/// Covariances of fewer images than features are singular: the Frechet distance is then too large.
void warn_of_few_images(const SetDistances& sets);

}  // namespace cloam
