// See old_names.h.
#include "models/train/old_names.h"

#include <algorithm>
#include <utility>

#include "runtime/error.h"

namespace cloam {
namespace {

constexpr size_t kShownOfOld = 64;  // characters of a value in an error

using Renamed = std::pair<const char*, const char*>;  // from, to

const Renamed kSettings[] = {
    {"train.average", "train.ema"},           {"schedule.times", "schedule.timesteps"},
    {"weight.stray", "weight.line_of_sight"}, {"train.distortion", "weight.distortion"},
    {"data.least_steps", "data.min_steps"},   {"growth.most", "growth.max"},
    {"growth.faint", "growth.prune_opacity"}, {"growth.small", "growth.split_scale"},
    {"growth.large", "growth.prune_scale"},   {"growth.from", "growth.start"},
    {"image.doublings", "image.upsamplings"}, {"image.side", "image.kernel"},
};

/// kept: the value that this version behaves as; empty: it mattered to training alone, and the run is the same without.
struct Gone {
  const char *name, *kept;
};
constexpr Gone kGone[] = {{"beyond.careful_new_logs", ""},
                          {"beyond.common_code", "false"},
                          {"beyond.field_offset", "false"},
                          {"train.decay_background", ""},
                          {"view.drop", ""}};

const Renamed kTensors[] = {{"state.average.", "state.ema."}};  // beginnings

}  // namespace

std::string current_setting(const std::string& key) {
  for (const auto& [from, to] : kSettings)
    if (key == from) return to;
  return key;
}

bool is_gone(const std::string& key, const std::string& value, const std::string& origin) {
  const auto* gone = std::find_if(std::begin(kGone), std::end(kGone), [&](const Gone& one) { return key == one.name; });
  if (gone == std::end(kGone)) return false;
  const std::string kept = gone->kept;
  if (!kept.empty() && value != kept)
    throw Error(Fault::data, text(origin, ": it was trained with ", key, " = ", value.substr(0, kShownOfOld),
                                  ", which this version no longer has\n  fix: train it again"));
  return true;
}

std::string current_tensor(const std::string& name) {
  for (const auto& [from, to] : kTensors)
    if (name.starts_with(from)) return to + name.substr(std::string(from).size());
  return name;
}

}  // namespace cloam
