// The methods and presets that train knows. A new method is one row here, one file pair beside this, one page in
// docs/methods/.
#pragma once
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "models/train/method.h"

namespace cloam {

struct Preset {
  using Settings = std::vector<std::pair<const char*, const char*>>;
  const char* name;
  const char* method;
  const char* summary;
  Settings settings;  // over the defaults
  int64_t steps;      // when neither --steps nor --time-budget is given
};

const std::vector<Preset>& presets();
/// Fault::usage with the known names.
const Preset& find_preset(const std::string& name);
std::unique_ptr<Method> make_method(const std::string& name);
std::vector<std::string> method_names();
/// The method that other programs know by this name ("3dgs", "instant-ngp"); the name itself if none is.
std::string method_of_alias(const std::string& name);

}  // namespace cloam
