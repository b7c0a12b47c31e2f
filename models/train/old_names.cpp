// See old_names.h.
#include "models/train/old_names.h"

#include <utility>

namespace cloam {
namespace {

using Renamed = std::pair<const char*, const char*>;  // from, to

const Renamed kSettings[] = {
    {"train.average", "train.ema"},           {"schedule.times", "schedule.timesteps"},
    {"weight.stray", "weight.line_of_sight"}, {"train.distortion", "weight.distortion"},
    {"data.least_steps", "data.min_steps"},   {"growth.most", "growth.max"},
    {"growth.faint", "growth.prune_opacity"}, {"growth.small", "growth.split_scale"},
    {"growth.large", "growth.prune_scale"},   {"growth.from", "growth.start"},
    {"image.doublings", "image.upsamplings"}, {"image.side", "image.kernel"},
};

const GoneSetting kGone[] = {{"beyond.careful_new_logs", ""}};

const Renamed kTensors[] = {{"state.average.", "state.ema."}};  // beginnings

}  // namespace

std::string current_setting(const std::string& key) {
  for (const auto& [from, to] : kSettings)
    if (key == from) return to;
  return key;
}

std::optional<GoneSetting> gone_setting(const std::string& key) {
  for (const GoneSetting& gone : kGone)
    if (key == gone.name) return gone;
  return std::nullopt;
}

std::string current_tensor(const std::string& name) {
  for (const auto& [from, to] : kTensors)
    if (name.starts_with(from)) return to + name.substr(std::string(from).size());
  return name;
}

}  // namespace cloam
