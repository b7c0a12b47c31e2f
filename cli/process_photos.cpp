// See process_photos.h.
#include "cli/process_photos.h"

#include <algorithm>
#include <atomic>
#include <map>
#include <mutex>
#include <tuple>

#include "cli/common.h"
#include "cli/stop_signal.h"
#include "models/data/near_misses.h"
#include "models/io/commit.h"
#include "models/io/image.h"
#include "models/io/in_parallel.h"
#include "models/io/photo_file.h"
#include "runtime/error.h"

namespace cloam {
namespace {

bool is_photo_of_phone(const fs::path& path) {
  return is_heic_name(path) || (is_image_name(path) && path.extension() != ".exr");
}

/// Whether it is hidden, or copies that `process` made.
bool passed_over(const fs::path& path) {
  std::error_code error;
  const std::string name = path.filename().string();
  return name.starts_with('.') || (name == "colmap" && fs::is_regular_file(path / "source.json", error));
}

/// Whether a photo is in images/ of the folder that `process` writes.
bool is_result(const fs::path& photo, const fs::path& out) {
  for (fs::path part = photo.parent_path(); !part.empty() && part != part.parent_path(); part = part.parent_path()) {
    std::error_code error;
    if (part.filename() == "images" && fs::equivalent(part, out / "images", error)) return true;
  }
  return false;
}

/// Names below the folder, sorted. others: whether some files there were passed over.
std::vector<std::string> photo_names(const fs::path& folder, const fs::path& out, bool& others) {
  std::error_code error;
  std::vector<std::string> names;
  fs::path video;
  fs::recursive_directory_iterator entry(folder, error), end;
  if (error == std::errc::permission_denied) throw Error(Fault::data, folder.string() + ": permission denied");
  for (; !error && entry != end; entry.increment(error)) {
    if (passed_over(entry->path())) {
      others = true;
      entry.disable_recursion_pending();
      continue;
    }
    if (is_photo_of_phone(entry->path()) && entry->is_regular_file(error))
      names.push_back(entry->path().lexically_relative(folder).generic_string());
    if (is_video_name(entry->path())) video = entry->path();
    if (entry->is_symlink(error) && entry->is_directory(error))
      warn(entry->path().string() + " is a link to a folder, which COLMAP does not follow; its photos are left out");
  }
  // Photos that lie nowhere but there are no copies.
  const auto results =
      std::partition(names.begin(), names.end(), [&](const auto& name) { return !is_result(folder / name, out); });
  if (results != names.begin() && results != names.end()) {
    names.erase(results, names.end());
    others = true;
  }
  std::sort(names.begin(), names.end());
  if (names.size() >= kFewestPhotos) return names;
  throw Error(Fault::data, text(folder.string(), ": holds ", names.size(), " photos (.jpg, .jpeg, .png, .heic), want ",
                                kFewestPhotos, " or more",
                                video.empty() ? "" : "\n  fix: give the video: " + process_command(video)));
}

/// IMG_1.HEIC becomes IMG_1.HEIC.jpg: IMG_1.jpg may be there, too.
std::string copy_name(const std::string& name) { return is_heic_name(name) ? name + ".jpg" : name; }

}  // namespace

ProcessPhotos photos_in(const fs::path& folder, const fs::path& out) {
  ProcessPhotos photos{folder, {}, {}, false, false};
  photos.names = photo_names(folder, out, photos.others);
  std::vector<PhotoHeader> headers(photos.names.size());
  in_parallel(headers.size(), [&](std::size_t i) {
    headers[i] = read_photo_header(folder / photos.names[i], is_heic_name(photos.names[i]));
  });
  std::map<std::tuple<int, int, std::string>, std::size_t> places;
  for (std::size_t i = 0; i < headers.size(); ++i) {
    const PhotoHeader& header = headers[i];
    const auto [place, is_new] = places.emplace(std::tuple(header.width, header.height, header.lens), places.size());
    if (is_new) photos.cameras.emplace_back();
    photos.cameras[place->second].push_back(i);
    photos.need_copies |= !header.upright || is_heic_name(photos.names[i]);
  }
  return photos;
}

ProcessPhotos upright_copies(const ProcessPhotos& photos, const fs::path& folder,
                             const std::function<void(double share)>& draw) {
  ProcessPhotos copies = photos;
  copies.folder = folder;
  copies.need_copies = copies.others = false;
  for (std::string& name : copies.names) name = copy_name(name);
  std::mutex drawing;
  std::size_t done = 0;
  in_parallel(copies.names.size(), [&](std::size_t i) {
    if (stop_signal.load() != 0) return;
    const fs::path from = photos.folder / photos.names[i], to = folder / copies.names[i];
    const bool is_heic = is_heic_name(from);
    std::error_code error;
    if (!is_heic && read_photo_header(from, false).upright)
      commit_link(from, to);
    else if (!fs::exists(to, error))
      write_upright(from, is_heic, to);
    const std::scoped_lock lock(drawing);
    draw(static_cast<double>(++done) / static_cast<double>(copies.names.size()));
  });
  return copies;
}

}  // namespace cloam
