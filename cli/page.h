// Parts of the pages that commands write: one HTML file without scripts that holds its pictures.
#pragma once
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "models/io/image.h"

namespace cloam {

/// RFC 4648.
std::string base64(std::span<const std::uint8_t> bytes);

/// Words as HTML shows them.
std::string escaped(const std::string& words);

/// A picture with a line below it, that wide on the page. Fault::data if the file is missing.
std::string figure(const std::filesystem::path& file, const std::string& caption, int width);

/// The same of a picture that lies in no file: a JPEG, smaller than a PNG.
std::string figure(const Image& image, const std::string& caption, int width);

/// Figures side by side.
std::string row_of(const std::string& figures);

/// refresh_seconds: after which a browser reads the page again; 0: never.
std::string html_page(const std::string& title, const std::string& body, int refresh_seconds = 0);

/// Files in a folder whose names begin and end so, sorted.
std::vector<std::filesystem::path> files_in(const std::filesystem::path& folder, const std::string& beginning,
                                            const std::string& ending);

}  // namespace cloam
