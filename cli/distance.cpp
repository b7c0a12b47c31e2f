// cloam distance: how alike two sets of pictures are as sets. FID and KID with the published weights of
// Inception, the same statistics under other names with others.
#include <nlohmann/json.hpp>

#include "cli/commands.h"
#include "cli/eval.h"
#include "cli/stop_signal.h"
#include "models/eval/image_sets.h"

namespace cloam {
namespace {

constexpr char kDistanceExamples[] = R"(Measure the distance between two sets of images, a folder each: FID and KID.

Examples:
  cloam distance samples photos --features pt_inception-2015-12-05-6726825d.pth
  cloam distance samples photos --features squeezenet.npz      # the same statistics with another network
  cloam distance samples photos --features random --json

The names FID and KID are for the published file of weights alone (docs/formats.md).)";

struct Measured {
  std::string network;
  SetDistances sets;
};

Measured measure(const DistanceRequest& request, const Common& common) {
  const std::vector<fs::path> a = images_in(request.folders.at(0)), b = images_in(request.folders.at(1));
  open_device(common);
  const Listener listener = listener_of(common);
  const FeatureNetwork network = features_named(request.features);
  const StopOnSignal signals("finishing this image");
  const SetDistances sets = set_distances(features_of(a, network, listener), features_of(b, network, listener));
  warn_of_few_images(sets, listener);
  return {network.name, sets};
}

nlohmann::ordered_json to_json(const Measured& measured) {
  nlohmann::ordered_json json = {{"schema_version", 1}, {"feature_network", measured.network}};
  add_sets(json, measured.network, measured.sets);
  return json;
}

int run_distance(const DistanceRequest& request, const Common& common) {
  const Measured measured = measure(request, common);
  common.json ? put_json(to_json(measured), 2) : put(set_lines(measured.network, measured.sets));
  return 0;
}

}  // namespace

nlohmann::ordered_json measure_distance(const DistanceRequest& request, const Common& common) {
  return to_json(measure(request, common));
}

Command add_distance(CLI::App& program) {
  return command<DistanceRequest>(program, "distance", kDistanceExamples, run_distance,
                                  [](const Options& add, DistanceRequest& r) {
                                    add("FOLDER", r.folders, "Two folders of images").required().expected(2);
                                    add("--features", r.features, "Weights of a feature network, or random").required();
                                  });
}

}  // namespace cloam
