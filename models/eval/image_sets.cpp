// See image_sets.h.
#include "models/eval/image_sets.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "models/data/load_images.h"
#include "models/eval/evaluate.h"
#include "models/eval/pictures.h"
#include "models/io/image.h"
#include "models/nn/inception.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

Eigen::MatrixXd features_of(const fs::path& file, const FeatureNetwork& network) {
  const Image image = read_image(file);
  if (std::min(image.width, image.height) < network.smallest)
    throw Error(Fault::data, text(file.string(), ": ", image.width, "x", image.height, " pixels, ", network.name,
                                  " needs at least ", network.smallest, " per side"));
  FramePixels pixels;
  pixels.width = image.width, pixels.height = image.height;
  pixels.rgba = as_rgba(image);
  return pooled_features(network, as_batch(on_white(pixels), image.width, image.height));
}

}  // namespace

std::vector<fs::path> images_in(const fs::path& folder) {
  if (!fs::is_directory(folder)) throw Error(Fault::data, text(folder.string(), ": not a folder of images"));
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(folder))
    if (is_image_name(entry.path())) files.push_back(entry.path());
  if (files.size() < 2)
    throw Error(Fault::data, text(folder.string(), ": at least two images (.png, .jpg, .exr) are needed, found ",
                                  files.size(), "; name a folder that holds them itself, not in folders below it"));
  std::sort(files.begin(), files.end());
  return files;
}

Eigen::MatrixXd features_of(const std::vector<fs::path>& files, const FeatureNetwork& network,
                            const Listener& listener) {
  constexpr std::size_t kTold = 200;
  Eigen::MatrixXd rows;
  for (std::size_t i = 0; i < files.size(); ++i) {
    listener.check_stop(
        [&] { return text(i, " of ", files.size(), " images in ", files[i].parent_path().string(), " were read"); });
    const Eigen::MatrixXd row = features_of(files[i], network);
    if (i == 0) rows.resize(static_cast<Eigen::Index>(files.size()), row.cols());
    rows.row(static_cast<Eigen::Index>(i)) = row;
    if ((i + 1) % kTold == 0) listener.say(text(files[i].parent_path().string(), "  ", i + 1, "/", files.size()));
  }
  return rows;
}

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

void warn_of_few_images(const SetDistances& sets, const Listener& listener) {
  const int64_t fewest = std::min(sets.images_a, sets.images_b);
  if (fewest > sets.features) return;
  listener.warn(text(fewest, " images for ", sets.features,
                     " features: the Frechet distance is biased upwards; compare it only between ",
                     "sets of equal size"));
}

}  // namespace cloam
