// Two sets of images as sets: their features, and their distances as reports have them. Keys are documented in
// docs/formats.md.
#pragma once
#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "models/metrics/feature_distance.h"
#include "models/nn/feature_network.h"
#include "models/runs/listener.h"

namespace cloam {

/// The images of a folder, sorted. Fault::data for less than two.
std::vector<std::filesystem::path> images_in(const std::filesystem::path& folder);

/// A row an image, on white where it is transparent. Fault::data for images that are too small for the network.
Eigen::MatrixXd features_of(const std::vector<std::filesystem::path>& files, const FeatureNetwork& network,
                            const Listener& listener);

/// fid and kid of the published Inception's features, frechet_feature_distance and kernel_feature_distance of others'.
void add_sets(nlohmann::ordered_json& json, const std::string& network, const SetDistances& sets);
/// A line each.
std::string set_lines(const std::string& network, const SetDistances& sets);
/// Covariances of fewer images than features are singular: the Frechet distance is then too large, which is told.
void warn_of_few_images(const SetDistances& sets, const Listener& listener);

}  // namespace cloam
