// Names that settings and the tensors of checkpoints had in earlier versions, so that old runs load and old commands
// work; and settings that are gone.
#pragma once
#include <string>

namespace cloam {

/// The name that a setting has now; the same for one that was never renamed.
std::string current_setting(const std::string& key);

/// Whether this is a setting of a run of an earlier version that is gone. Fault::data where the run needs it; origin:
/// what the error calls the run.
bool is_gone(const std::string& key, const std::string& value, const std::string& origin);

/// The same for a tensor of a checkpoint ("state.average.unet.in.weight").
std::string current_tensor(const std::string& name);

}  // namespace cloam
