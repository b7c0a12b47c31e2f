// Photos as phones write them: which way up, by which lens, and upright copies of them for programs that ask for
// neither.
#pragma once
#include <filesystem>
#include <string>

namespace cloam {

/// Of a photo as it is to be looked at.
struct PhotoHeader {
  int width = 0, height = 0;  // in pixels, upright
  bool upright = true;        // whether it is stored so
  std::string lens;           // camera and focal length as EXIF has them: equal for photos of one lens; "" without EXIF
};

/// The header of a JPEG, PNG or (is_heic) HEIC file. Fault::data as read_image_size; for HEIC, too, where OpenImageIO
/// was built without it.
PhotoHeader read_photo_header(const std::filesystem::path& path, bool is_heic);

/// Stores the photo upright in the format of `to`'s extension, with its EXIF. A JPEG has the quality kJpegQuality and
/// all of its colours. Replaces `to` in one step. Fault::data for a damaged photo, Fault::write.
void write_upright(const std::filesystem::path& from, bool is_heic, const std::filesystem::path& to);

}  // namespace cloam
