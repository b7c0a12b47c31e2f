// See asset_codes.h.
#include "models/methods/asset_codes.h"

#include <charconv>
#include <cmath>

#include "models/io/tensors.h"
#include "models/methods/genassets_model.h"
#include "models/scene/asset_class.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr int64_t kLargest = 1 << 14;  // channels and side of a code
constexpr char kMethod[] = "genassets";
constexpr char kFix[] = "\n  fix: cloam train genassets LOG... --preset genassets-small -o RUN, and name that run";

/// As the run has it, or the default.
std::string setting(const SourceRun& source, const std::string& key, const std::string& otherwise) {
  const auto found = source.settings.find(key);
  return found == source.settings.end() ? otherwise : found->second;
}

int64_t extent(const SourceRun& source, const std::string& key, int otherwise) {
  const std::string value = setting(source, key, std::to_string(otherwise));
  int64_t number = 0;
  std::from_chars(value.data(), value.data() + value.size(), number);
  if (number >= 1 && number <= kLargest) return number;
  throw Error(Fault::data,
              text(source.folder.string(), ": its setting ", key, " is ", value, ", want 1 to ", kLargest));
}

/// The actors of one log, added to `codes`. What all codes of a log share is part of each.
void add_log(AssetCodes& codes, const SourceRun& source, size_t log, bool variational, int64_t least_steps) {
  const Scene& scene = source.scenes[log];
  const auto actors = static_cast<int64_t>(scene.actors.size()), numbers = codes.channels * codes.side * codes.side;
  if (actors == 0) return;
  const std::string prefix = text("log", log, "."), name = prefix + "codes";
  const int64_t width = numbers * (variational ? 2 : 1);
  const auto rows = values_from<float>(source.parameters, name, {actors, width});
  const auto common = values_from<float>(source.parameters, prefix + "common.code", {1, width});
  const auto steps = values_from<int32_t>(source.row_steps, name, {actors});
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

CodeShape code_shape(const SourceRun& source) {
  if (source.method != kMethod)
    throw Error(Fault::data,
                text("the run's method is ", source.method, ", whose scenes have no assets; want ", kMethod, kFix));
  if (source.edited_from)
    throw Error(Fault::data, text("the run is edited: its actors may have the appearance of others\n  fix: name ",
                                  *source.edited_from, ", which it was made from"));
  if (setting(source, "decoder.use", "true") != "true")
    throw Error(Fault::data, text("the run learned its actors' planes directly (decoder.use = false): there are no "
                                  "codes to learn from",
                                  kFix));
  return {extent(source, "code.channels", StreetModelOptions().code_channels),
          extent(source, "code.side", StreetModelOptions().code_side),
          setting(source, "code.variational", "true") == "true"};
}

AssetCodes asset_codes(const SourceRun& source, int64_t least_steps) {
  const CodeShape shape = code_shape(source);
  AssetCodes codes;
  codes.channels = shape.channels;
  codes.side = shape.side;
  for (size_t log = 0; log < source.scenes.size(); ++log) add_log(codes, source, log, shape.variational, least_steps);
  if (codes.count() > 0) return codes;
  throw Error(Fault::data, text(source.folder.string(), " has no actor to learn from: of ", codes.unseen,
                                " in its logs none was seen in ", least_steps, " steps of its training", kFix));
}

}  // namespace cloam
