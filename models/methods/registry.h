// The methods and presets that train knows. A new method is one row here, one file pair beside this, one page in
// docs/methods/.
#pragma once
#include <algorithm>
#include <memory>
#include <string>
#include <typeindex>
#include <utility>
#include <vector>

#include "models/train/capability.h"

namespace cloam {

[[noreturn]] void lacks(const std::string& method, const std::string& what, std::type_index capability);

struct Preset {
  using Settings = std::vector<std::pair<std::string, std::string>>;
  const char* name;
  const char* method;
  const char* summary;
  Settings settings;   // over the defaults
  int64_t steps;       // when neither --steps nor --time-budget is given
  int64_t epochs = 0;  // instead of steps, of methods that see one image a step: how often it sees each
};

const std::vector<Preset>& presets();
std::vector<std::string> preset_names();
/// Those of a method, in the table's order.
std::vector<std::string> presets_of(const std::string& method);
/// Fault::usage with the known names.
const Preset& find_preset(const std::string& name);
std::unique_ptr<Method> make_method(const std::string& name);
std::vector<std::string> method_names();

/// The methods that have a capability, told from their types: nothing is constructed.
std::vector<std::string> methods_with(std::type_index capability);
template <class Capability>
bool has(const std::string& method) {
  const std::vector<std::string> names = methods_with(typeid(Capability));
  return std::find(names.begin(), names.end(), method) != names.end();
}
/// The capability of a method that must have it. Fault::usage that says `what` needs it, and which methods have it.
template <class Capability>
Capability& require(Method& method, const std::string& name, const std::string& what) {
  if (Capability* capability = as<Capability>(method)) return *capability;
  lacks(name, what, typeid(Capability));
}

/// The method that other programs know by this name ("3dgs", "instant-ngp"); the name itself if none is.
std::string method_of_alias(const std::string& name);

}  // namespace cloam
