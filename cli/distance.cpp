// cloam distance: how alike two sets of pictures are as sets. FID and KID with the weights of Inception, the same
// statistics under other names with other networks.
#include "cli/distance.h"

#include <CLI/CLI.hpp>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "cli/commands.h"
#include "cli/eval.h"
#include "cli/set_report.h"
#include "cli/stop_signal.h"
#include "models/data/load_images.h"
#include "models/eval/evaluate.h"
#include "models/eval/pictures.h"
#include "models/io/image.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr char kExamples[] = R"(Measure the distance between two sets of images, a folder each: FID and KID.

Examples:
  cloam distance samples photos --features inception.safetensors
  cloam distance samples photos --features squeezenet.npz      # the same statistics with another network
  cloam distance samples photos --features random --json

docs/formats.md says how to get a file with Inception weights.)";

std::vector<fs::path> images_in(const fs::path& folder) {
  if (!fs::is_directory(folder)) throw Error(Fault::data, text(folder.string(), ": not a folder of images"));
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(folder))
    if (is_image_name(entry.path())) files.push_back(entry.path());
  if (files.size() < 2)
    throw Error(Fault::data,
                text(folder.string(), ": at least two images (.png, .jpg, .exr) are needed, found ", files.size()));
  std::sort(files.begin(), files.end());
  return files;
}

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

Eigen::MatrixXd features_of(const std::vector<fs::path>& files, const FeatureNetwork& network, const Common& common) {
  constexpr std::size_t kTold = 200;
  Eigen::MatrixXd rows;
  const StopOnSignal signals("finishing this image");
  for (std::size_t i = 0; i < files.size(); ++i) {
    check_stop(
        [&] { return text(i, " of ", files.size(), " images in ", files[i].parent_path().string(), " were read"); });
    const Eigen::MatrixXd row = features_of(files[i], network);
    if (i == 0) rows.resize(static_cast<Eigen::Index>(files.size()), row.cols());
    rows.row(static_cast<Eigen::Index>(i)) = row;
    if ((i + 1) % kTold == 0) say(common, text(files[i].parent_path().string(), "  ", i + 1, "/", files.size()));
  }
  return rows;
}

struct Measured {
  std::string network;
  SetDistances sets;
};

Measured measure(const DistanceRequest& request, const Common& common) {
  const std::vector<fs::path> a = images_in(request.folders.at(0)), b = images_in(request.folders.at(1));
  open_device(common);
  const FeatureNetwork network = features_named(request.features);
  const SetDistances sets = set_distances(features_of(a, network, common), features_of(b, network, common));
  warn_of_few_images(sets);
  return {network.name, sets};
}

nlohmann::ordered_json to_json(const Measured& measured) {
  nlohmann::ordered_json json = {{"schema_version", 1}, {"feature_network", measured.network}};
  add_sets(json, measured.network, measured.sets);
  return json;
}

int run_command(const DistanceRequest& request, const Common& common) {
  const Measured measured = measure(request, common);
  put(common.json ? to_json(measured).dump(2) + "\n" : set_lines(measured.network, measured.sets));
  return 0;
}

}  // namespace

nlohmann::ordered_json measure_distance(const DistanceRequest& request, const Common& common) {
  return to_json(measure(request, common));
}

Command add_distance(CLI::App& program) {
  return command<DistanceRequest>(
      program, "distance", kExamples, run_command, [](const Options& add, DistanceRequest& r) {
        add("FOLDER", r.folders, "Two folders of images")->required()->expected(2);
        add("--features", r.features, "Weights of a feature network, or random")->required();
      });
}

}  // namespace cloam
