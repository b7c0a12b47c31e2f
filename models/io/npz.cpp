// See npz.h.
#include "models/io/npz.h"

#include "models/io/bytes.h"
#include "models/io/npy.h"
#include "models/io/safetensors_header.h"  // printable
#include "runtime/error.h"

namespace cloam {
namespace {

NamedTensor as_tensor(const NpyArray& array) {
  const std::vector<float> values = npy_floats(array);
  const auto bytes = std::as_bytes(std::span(values));
  return {"F32", {array.shape.begin(), array.shape.end()}, {bytes.begin(), bytes.end()}};
}

}  // namespace

TensorMap npz_tensors(const Zip& zip) {
  TensorMap all;
  for (const ZipEntry& entry : zip.entries()) {
    const std::string label = text(zip.name(), ": member ", printable(entry.name));
    if (!entry.name.ends_with(".npy")) bad_data(label, ": want only .npy members");
    const std::vector<std::uint8_t> content = zip.content(entry);
    const std::string name = entry.name.substr(0, entry.name.size() - 4);
    if (!all.emplace(name, as_tensor(parse_npy(content, label))).second) bad_data(label, ": appears twice");
  }
  return all;
}

TensorMap read_npz(const std::filesystem::path& path) {
  const std::vector<std::uint8_t> bytes = read_file(path, std::uint64_t{2} << 30);
  return npz_tensors(Zip(bytes, path.string()));
}

}  // namespace cloam
