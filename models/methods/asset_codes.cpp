// See asset_codes.h.
#include "models/methods/asset_codes.h"

#include <cmath>

#include "models/methods/genassets.h"
#include "models/scene/asset_class.h"
#include "models/train/tensors.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr int64_t kLargest = 1 << 14;  // channels and side of a code
constexpr char kFix[] = "\n  fix: cloam train genassets LOG... --preset genassets-small -o RUN, and name that run";

template <class Value>
Value setting(const Config& config, const std::string& key) {
  for (const ConfigEntry& entry : config.entries())
    if (entry.key == key) return std::get<Value>(entry.value);
  throw Error(Fault::internal, text("[asset codes] genassets has no setting ", key));
}

/// The actors of one log, added to `codes`. What all codes of a log share is part of each.
void add_log(AssetCodes& codes, const StoredRun& source, size_t log, bool variational, int64_t least_steps) {
  const Scene& scene = source.scenes[log];
  const auto actors = static_cast<int64_t>(scene.actors.size()), numbers = codes.channels * codes.side * codes.side;
  if (actors == 0) return;
  const std::string prefix = text("log", log, "."), name = prefix + "codes";
  const int64_t width = numbers * (variational ? 2 : 1);
  const TensorMap& all = source.checkpoint.file.tensors;
  const auto rows = values_from<float>(all, "param." + name, {actors, width});
  const auto common = values_from<float>(all, "param." + prefix + "common.code", {1, width});
  const auto steps = values_from<int32_t>(all, "adam.steps." + name, {actors});
  for (size_t a = 0; a < scene.actors.size(); ++a) {
    if (steps[a] < least_steps) {
      codes.unseen++;
      continue;
    }
    for (size_t i = 0; i < common.size(); ++i) {
      const float value = rows[a * common.size() + i] + common[i];
      if (i < static_cast<size_t>(numbers))
        codes.means.push_back(value);
      else
        codes.deviations.push_back(std::exp(0.5f * (value + kCodeLogVariance)));
    }
    codes.classes.push_back(asset_class(scene.actors[a].label));
    codes.nights.push_back(scene.night ? 1 : 0);
    codes.sizes.push_back(scene.actors[a].size);
  }
}

}  // namespace

CodeShape code_shape(const RunRecord& source) {
  if (source.method != GenAssets().name())
    throw Error(Fault::data, text("the run is one of ", source.method, ", whose scenes have no assets; want one of ",
                                  GenAssets().name(), kFix));
  if (source.edited_from)
    throw Error(Fault::data, text("the run is an edited one, where actors may have the looks of others\n  fix: name ",
                                  source.edited_from->given, ", which it was made from"));
  Config config;
  const auto method = configured_method(source, config);
  if (!setting<bool>(config, "decoder.use"))
    throw Error(Fault::data, text("the run learned its actors' planes directly (decoder.use = false): there are no "
                                  "codes to learn from",
                                  kFix));
  const CodeShape shape = {setting<int64_t>(config, "code.channels"), setting<int64_t>(config, "code.side"),
                           setting<bool>(config, "code.variational")};
  for (const int64_t extent : {shape.channels, shape.side})
    if (extent < 1 || extent > kLargest)
      throw Error(Fault::data, text("the run's codes have ", shape.channels, " channels and ", shape.side,
                                    " places a side: want 1 to ", kLargest));
  return shape;
}

AssetCodes asset_codes(const StoredRun& source, int64_t least_steps) {
  const CodeShape shape = code_shape(source.record);
  AssetCodes codes;
  codes.channels = shape.channels;
  codes.side = shape.side;
  for (size_t log = 0; log < source.scenes.size(); ++log) add_log(codes, source, log, shape.variational, least_steps);
  if (codes.count() > 0) return codes;
  throw Error(Fault::data, text(source.folder.string(), " has no actor to learn from: of ", codes.unseen,
                                " in its logs none was seen in ", least_steps, " steps of its training", kFix));
}

}  // namespace cloam
