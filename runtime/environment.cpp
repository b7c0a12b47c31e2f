// See environment.h.
#include "runtime/environment.h"

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <sstream>
#include <string>
#include <vector>

#include "runtime/error.h"
#include "runtime/nearest_name.h"

namespace cloam {
namespace {

struct Variable {
  const char* name;
  std::vector<std::string> values;
  bool is_list = false;  // of such values, between commas
};

const Variable kVariables[] = {{"CLOAM_DEBUG", {"kernels", "nan", "poison", "bounds", "sync", "float64"}, true},
                               {"CLOAM_DEVICE_CLASS", {"cpu", "gpu"}},
                               {"CLOAM_VARIANT", {"reference"}},
                               {"CLOAM_RANK_MEMORY", {"apart", "common"}},
                               {"CLOAM_TUNE", {"off", "on"}}};

void check(const Variable& variable, const std::string& word) {
  if (word.empty() || std::find(variable.values.begin(), variable.values.end(), word) != variable.values.end()) return;
  std::string known;
  for (const std::string& value : variable.values) known += (known.empty() ? "" : ", ") + value;
  throw Error(Fault::usage,
              text(variable.name, "=", word, ": want ",
                   variable.is_list             ? "some of "
                   : variable.values.size() > 1 ? "one of "
                                                : "",
                   known, did_you_mean(word, variable.values), "\n  fix: correct it, or unset ", variable.name));
}

}  // namespace

void check_environment() {
  for (const Variable& variable : kVariables) {
    const char* given = std::getenv(variable.name);
    std::istringstream words(given ? given : "");
    for (std::string word; std::getline(words, word, variable.is_list ? ',' : '\n');) check(variable, word);
  }
  const char* kernels = std::getenv("CLOAM_KERNEL_DIR");
  std::error_code error;
  if (kernels && !std::filesystem::is_directory(kernels, error))
    throw Error(Fault::usage, text("CLOAM_KERNEL_DIR=", kernels, ": looked for a folder of kernels, found none there",
                                   "\n  fix: name one, such as kernels/ of the source, or unset CLOAM_KERNEL_DIR"));
}

}  // namespace cloam
