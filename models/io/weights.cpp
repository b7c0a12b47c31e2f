// See weights.h.
#include "models/io/weights.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <fstream>

#include "models/io/bytes.h"
#include "models/io/npz.h"
#include "models/io/paths.h"
#include "models/io/safetensors_header.h"  // printable, shape_text
#include "models/io/sha256.h"
#include "models/io/tensors.h"
#include "models/io/torch_file.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

enum class Format { none, zip, old_torch, safetensors };

constexpr std::uint64_t kLargestFile = std::uint64_t{2} << 30;

/// safetensors begin with the length of a header, which begins with a brace.
Format format_of(const fs::path& path) {
  std::error_code error;
  if (!fs::is_regular_file(path, error)) return Format::none;
  std::array<std::uint8_t, 16> start{};
  std::ifstream file(path, std::ios::binary);
  file.read(reinterpret_cast<char*>(start.data()), start.size());
  const auto count = static_cast<size_t>(file.gcount());
  if (is_zip({start.data(), count})) return Format::zip;
  if (is_old_torch({start.data(), count})) return Format::old_torch;
  std::uint64_t header = 0;
  std::memcpy(&header, start.data(), sizeof header);
  const bool braced = count > 8 && start[8] == '{' && header < fs::file_size(path, error);
  return braced && !error ? Format::safetensors : Format::none;
}

std::string beginning_of(const fs::path& path) {
  std::string start(64, '\0');
  std::ifstream file(path, std::ios::binary);
  file.read(start.data(), static_cast<std::streamsize>(start.size()));
  return start.substr(0, static_cast<std::size_t>(file.gcount()));
}

fs::path the_file(const fs::path& path) {
  std::error_code error;
  if (!fs::is_directory(path, error)) return path;
  std::vector<fs::path> found = entries_of(path);
  std::erase_if(found, [](const fs::path& entry) { return format_of(entry) == Format::none; });
  if (found.size() == 1) return found[0];
  std::string names;
  for (const fs::path& file : found) names += " " + file.filename().string();
  bad_data(path.string(), ": want a folder with one file of weights (.npz, .pth or safetensors), found ",
           found.empty() ? "none" : "several:", names, "; name the file itself");
}

TensorMap tensors_of(const fs::path& file, Format format) {
  if (format == Format::safetensors) return read_safetensors(file).tensors;
  const std::vector<std::uint8_t> bytes = read_file(file, kLargestFile);
  if (format == Format::old_torch) return old_torch_tensors(bytes, file.string());
  const Zip zip(bytes, file.string());
  return is_torch(zip) ? torch_tensors(zip) : npz_tensors(zip);
}

}  // namespace

std::vector<float> Weights::take(const std::string& name, const std::vector<int64_t>& shape) const {
  const std::string wanted = text(file.string(), ": looked for ", name, " F32 ", shape_text(shape), ", found ");
  const auto at = tensors.find(name);
  if (at == tensors.end()) bad_data(wanted + content());
  if (at->second.shape != shape || at->second.dtype != "F32")
    bad_data(wanted, at->second.dtype, " ", shape_text(at->second.shape));
  const std::vector<float> values = values_from<float>(tensors, name, shape);
  if (!std::all_of(values.begin(), values.end(), [](float value) { return std::isfinite(value); }))
    bad_data(wanted + "NaN or infinite values in it");
  return values;
}

std::string Weights::content() const {
  constexpr size_t kShown = 4;
  std::string all;
  size_t shown = 0;
  for (const auto& [name, tensor] : tensors) {
    if (shown++ == kShown) break;
    all += text(shown > 1 ? ", " : "", printable(name), " ", tensor.dtype, " ", shape_text(tensor.shape));
  }
  if (tensors.size() > kShown) all += text(" and ", tensors.size() - kShown, " more");
  return all.empty() ? "no tensor" : all;
}

Weights read_weights(const fs::path& path) {
  const fs::path file = the_file(path);
  const Format format = format_of(file);
  if (format == Format::none)
    bad_data(
        file.string(), ": want a file of weights (.npz, .pth or safetensors), found ",
        fs::exists(file) ? "something else" + other_kind(beginning_of(file)) : "no file" + did_you_mean_path(file),
        "\n  fix: name the file that the network's authors publish (docs/formats.md, Weights of feature networks)");
  return {file, tensors_of(file, format), sha256_of_file(file)};
}

}  // namespace cloam
