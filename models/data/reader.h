// What every reader of a capture format offers. A new format is a file pair in models/data/ and one row in the table
// of read_scene.cpp.
#pragma once
#include <filesystem>

#include "models/scene/scene.h"

namespace cloam {

struct ReadOptions {
  bool skip_bad = false;       // drop frames that are damaged, with a warning, instead of stopping
  bool allow_outside = false;  // files that a manifest names by paths that leave the folder are read, too
};

struct SceneReader {
  const char* name;                                       // "transforms.json"
  const char* looked_for;                                 // the files that show the format, for the user
  bool (*recognises)(const std::filesystem::path& root);  // looks at names only; never throws
  Scene (*read)(const std::filesystem::path& root, const ReadOptions& options);
};

}  // namespace cloam
