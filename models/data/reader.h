// What every reader of a capture format offers. A new format is a file pair in models/data/ and one row in the table
// of read_scene.cpp.
#pragma once
#include <filesystem>

#include "models/scene/scene.h"
#include "runtime/error.h"

namespace cloam {

/// Metres that a driving log may lead away from its origin, or from where the car is at first: float32 still tells 8 mm
/// apart there.
constexpr double kFarthestOfLog = 1e5;

struct ReadOptions {
  bool skip_bad = false;       // drop frames that are damaged, with a warning, instead of stopping
  bool allow_outside = false;  // files that a manifest names by paths that leave the folder are read, too
};

/// Runs `step`, and with skip_bad turns its complaint about the data into a warning: "frame dropped: ...".
template <class Step>
void guarded(bool skip_bad, std::vector<std::string>& warnings, const std::string& what, Step step) {
  try {
    step();
  } catch (const Error& error) {
    if (!skip_bad || error.fault() != Fault::data) throw;
    warnings.push_back(text(what, ": ", error.what()));
  }
}

struct SceneReader {
  const char* name;                                       // "transforms.json"
  const char* looked_for;                                 // the files that show the format, for the user
  bool (*recognises)(const std::filesystem::path& root);  // looks at names only; never throws
  Scene (*read)(const std::filesystem::path& root, const ReadOptions& options);
};

}  // namespace cloam
