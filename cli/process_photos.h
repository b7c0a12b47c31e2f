// The photos that COLMAP is given: which they are, which were taken by one camera, and upright copies where it would
// not see them as they are.
#pragma once
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

namespace cloam {

struct ProcessPhotos {
  std::filesystem::path folder;
  std::vector<std::string> names;  // below the folder, sorted
  /// Places among the names, by size as looked at and lens; each photo belongs to one.
  std::vector<std::vector<std::size_t>> cameras;
  bool need_copies =
      false;            // some are HEIC, or lie on their side: COLMAP reads no HEIC and follows no EXIF orientation
  bool others = false;  // the folder holds files besides that COLMAP would take for photos
};

/// Fewest photos that make a capture.
constexpr std::size_t kFewestPhotos = 3;

/// Reads every header: what COLMAP would leave out in silence stops here. Hidden files and folders (.thumbnails,
/// ._a.jpg) are no photos, nor is what `process` itself laid into `out` or into a folder colmap/. Warns of links to
/// folders. Fault::data for fewer than three photos and for those that cannot be read.
ProcessPhotos photos_in(const std::filesystem::path& folder, const std::filesystem::path& out);

/// All photos in `folder`, which is made, upright and as JPEG or PNG: second names of the files where they are that
/// already. Those that lie there are taken as they are. draw: is told how much is done, from 0 to 1. Ends early once
/// stop_signal is set. Errors as write_upright.
ProcessPhotos upright_copies(const ProcessPhotos& photos, const std::filesystem::path& folder,
                             const std::function<void(double share)>& draw);

}  // namespace cloam
