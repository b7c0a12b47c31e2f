// Names that settings and the tensors of checkpoints had in earlier versions, so that old runs load and old commands
// work; and settings that are gone.
#pragma once
#include <optional>
#include <string>

namespace cloam {

/// The name that a setting has now; the same for one that was never renamed.
std::string current_setting(const std::string& key);

/// A setting of earlier versions that is gone. kept: the value that this version behaves as; empty: it mattered to
/// training alone, so that a trained run is the same without it.
struct GoneSetting {
  std::string name, kept;
};
/// None for one that there is, or never was.
std::optional<GoneSetting> gone_setting(const std::string& key);

/// The same for a tensor of a checkpoint ("state.average.unet.in.weight").
std::string current_tensor(const std::string& name);

}  // namespace cloam
