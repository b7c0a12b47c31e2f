// See page.h.
#include "cli/page.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>

#include "models/io/bytes.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr uint64_t kLargestPicture = 64 << 20;
constexpr int kQuality = 85;  // of JPEGs
constexpr char kPageStyle[] = R"(
body { font: 16px/1.5 sans-serif; max-width: 76rem; margin: 2rem auto; padding: 0 1rem; color: #222 }
table { border-collapse: collapse; margin: 1rem 0 }
td, th { padding: .3rem .8rem; border-bottom: 1px solid #ccc; text-align: left }
td.number { text-align: right; white-space: nowrap }
.row { display: flex; flex-wrap: wrap; gap: .6rem; align-items: flex-end }
figure { margin: 0 } figcaption { color: #666; font-size: .85rem } img { max-width: 100%; display: block }
pre { background: #f4f4f4; padding: 1rem; white-space: pre-wrap; overflow-wrap: anywhere }
svg { max-width: 100%; height: auto }
@media (prefers-color-scheme: dark) {
  body { background: #16181c; color: #ddd } figcaption { color: #aaa } pre { background: #24272d }
  td, th { border-color: #444 }
}
)";

std::string figure_of(const std::string& type, const std::vector<std::uint8_t>& bytes, const std::string& caption,
                      int width) {
  return fmt::format(
      "<figure><img width=\"{}\" alt=\"{}\" src=\"data:image/{};base64,{}\"><figcaption>{}</figcaption></figure>\n",
      width, escaped(caption), type, base64(bytes), escaped(caption));
}

}  // namespace

std::string base64(std::span<const std::uint8_t> bytes) {
  constexpr char kDigits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  out.reserve(bytes.size() / 3 * 4 + 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::size_t count = std::min<std::size_t>(3, bytes.size() - i);
    uint32_t bits = 0;
    for (std::size_t k = 0; k < 3; ++k) bits = bits << 8 | (k < count ? bytes[i + k] : 0u);
    for (std::size_t k = 0; k < 4; ++k) out += k <= count ? kDigits[bits >> (18 - 6 * k) & 63] : '=';
  }
  return out;
}

std::string escaped(const std::string& words) {
  std::string out;
  for (const char c : words)
    out += c == '&' ? "&amp;" : c == '<' ? "&lt;" : c == '>' ? "&gt;" : c == '"' ? "&quot;" : std::string(1, c);
  return out;
}

std::string figure(const fs::path& file, const std::string& caption, int width) {
  const std::string type = file.extension() == ".jpg" ? "jpeg" : file.extension().string().substr(1);
  return figure_of(type, read_file(file, kLargestPicture), caption, width);
}

std::string figure(const Image& image, const std::string& caption, int width) {
  return figure_of("jpeg", jpeg_bytes(image, kQuality), caption, width);
}

std::string row_of(const std::string& figures) { return "<div class=\"row\">\n" + figures + "</div>\n"; }

std::vector<fs::path> files_in(const fs::path& folder, const std::string& beginning, const std::string& ending) {
  std::vector<fs::path> found;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder)) {
    const std::string name = entry.path().filename().string();
    if (name.starts_with(beginning) && name.ends_with(ending)) found.push_back(entry.path());
  }
  std::sort(found.begin(), found.end());
  return found;
}

std::string html_page(const std::string& title, const std::string& body, int refresh_seconds) {
  const std::string refresh =
      refresh_seconds > 0 ? text("<meta http-equiv=\"refresh\" content=\"", refresh_seconds, "\">") : "";
  return "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">" + refresh + "<title>" + escaped(title) +
         "</title><style>" + kPageStyle + "</style></head><body>\n<h1>" + escaped(title) + "</h1>\n" + body +
         "</body></html>\n";
}

}  // namespace cloam
