// Files of gaussians: the table of formats, and reading and writing by a file's extension. A new format is a row here.
#pragma once
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "models/gaussians/gaussians.h"

namespace cloam {

struct SplatFile {
  Gaussians gaussians;
  std::vector<std::string> warnings;  // one line each, for the user
};

struct SplatFormat {
  const char* name;                                      // for people
  const char* extension;                                 // may have two parts; the first in the table that fits
  SplatFile (*read)(const std::filesystem::path& path);  // null: known, but not read
  void (*write)(const std::filesystem::path& path, const Gaussians& gaussians);  // null: not written
  std::vector<std::size_t> (*order)(const Gaussians& gaussians) = nullptr;       // that are written; null: as given
};

std::span<const SplatFormat> splat_formats();

/// By the extension, in any case. Fault::usage that lists those that there are.
const SplatFormat& splat_format(const std::filesystem::path& path, bool write = true);

/// World axes are the file's; `up` is what the file or its format says of them. Gaussians with values that are not
/// finite, or a rotation of length 0, are left out with a warning. Fault::data for a damaged file, one of another
/// format, and one without gaussians; sizes are checked before memory is asked for.
SplatFile read_gaussians(const std::filesystem::path& path);

/// Replaces `path` in one step. Formats with an up axis of their own (all but .ply) get the gaussians turned to it.
/// Fault::usage where the format is not written, Fault::data where the gaussians do not fit it, Fault::write.
void write_gaussians(const std::filesystem::path& path, const Gaussians& gaussians);

/// The largest differences between gaussians and what a file made of them.
struct SplatErrors {
  double position = 0;   // scene units
  double scale = 0;      // of deviations, relative
  double rotation = 0;   // degrees
  double opacity = 0;    // of 1
  double colour = 0;     // the same from all sides, of 1
  double harmonics = 0;  // coefficients of degrees 1 to 3
};

/// Reads a file that was written from `gaussians` and compares. Fault::verification where their number is another one.
SplatErrors reread_errors(const std::filesystem::path& path, const Gaussians& gaussians);

}  // namespace cloam
