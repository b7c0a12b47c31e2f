// Files of weights: .npz as numpy writes it, and what becomes of a path that holds something else.
#include "models/io/weights.h"

#include <doctest/doctest.h>

#include "models/io/npz.h"
#include "runtime/error.h"
#include "tests/models/errors.h"
#include "tests/models/folder.h"
#include "tests/models/zip_bytes.h"

using namespace cloam;

namespace {

namespace fs = std::filesystem;
Bytes npy(const std::string& shape, const std::vector<float>& values) {
  std::string header = "{'descr': '<f4', 'fortran_order': False, 'shape': (" + shape + "), }";
  header.resize(117, ' ');
  Bytes all;
  add(all, "\x93NUMPY");
  add(all, 1, 2);
  add(all, header.size() + 1, 2);
  add(all, header + "\n");
  const auto* raw = reinterpret_cast<const std::uint8_t*>(values.data());
  all.insert(all.end(), raw, raw + 4 * values.size());
  return all;
}

const std::vector<float> kValues = {1, 2, 3, 4, 5, 6};

Bytes sound() { return zip_bytes({{"a.weight.npy", npy("2, 3", kValues), true}, {"b/bias.npy", npy("1,", {7})}}); }

}  // namespace

TEST_CASE("npz: stored and deflated members") {
  const Folder folder;
  put(folder.path / "x.npz", sound());
  const Weights weights = read_weights(folder.path / "x.npz");
  CHECK(weights.tensors.size() == 2);
  CHECK(weights.take("a.weight", {2, 3}) == kValues);
  CHECK(weights.take("b/bias", {1}) == std::vector<float>{7});
  CHECK(holds(error_of([&] { weights.take("b/bias", {2}); }), "looked for b/bias F32 [2], found F32 [1]"));
  CHECK(holds(error_of([&] { weights.take("c", {2}); }), "found a.weight F32 [2,3], b/bias F32 [1]"));
}

TEST_CASE("npz: every cut and every changed byte is an error or changes nothing") {
  const Folder folder;
  const fs::path path = folder.path / "x.npz";
  const Bytes all = sound();
  put(path, all);
  const TensorMap whole = read_npz(path);
  for (size_t length = 0; length < all.size(); length += 5) {
    put(path, Bytes(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(length)));
    CHECK(error_of([&] { read_npz(path); }) != "no error");
  }
  int errors = 0;
  for (size_t i = 0; i < all.size(); i++) {
    Bytes changed = all;
    changed[i] ^= 0x81;
    put(path, changed);
    try {
      TensorMap found = read_npz(path);
      for (const auto& [name, tensor] : whole) {  // names may change: nothing checks them
        const bool same = found.size() == whole.size() && (!found.count(name) || found[name] == tensor);
        CHECK_MESSAGE(same, "byte ", i);
      }
    } catch (const Error& error) {
      CHECK(error.fault() == Fault::data);
      errors++;
    }
  }
  CHECK(errors > 300);
}

TEST_CASE("npz: sizes are checked before memory is asked for") {
  const Folder folder;
  const fs::path path = folder.path / "x.npz";
  put(path, zip_bytes({{"a.npy", npy("6,", kValues), true, 4000000000u}}));
  CHECK(holds(error_of([&] { read_npz(path); }), "unpack to 4000000000"));
  put(path, zip_bytes({{"a.npy", npy("6,", kValues), true, 10000000u}}));
  CHECK(holds(error_of([&] { read_npz(path); }), "does not unpack to 10000000"));
  put(path, zip_bytes({{"a.npy", npy("6,", kValues)}, {"a.npy", npy("6,", kValues)}}));
  CHECK(holds(error_of([&] { read_npz(path); }), "twice"));
  put(path, zip_bytes({{"a.txt", npy("6,", kValues)}}));
  CHECK(holds(error_of([&] { read_npz(path); }), "want only .npy"));
}

TEST_CASE("a folder with one file of weights stands for it") {
  const Folder folder;
  CHECK(holds(error_of([&] { read_weights(folder.path); }), "found none"));
  put(folder.path / "README", {'P', 'K'});
  put(folder.path / "weights", sound());  // content, not extension, says what it is
  CHECK(read_weights(folder.path).file == folder.path / "weights");
  write_safetensors(folder.path / "more.npz", {});
  CHECK(holds(error_of([&] { read_weights(folder.path); }), "found several: more.npz weights"));
  CHECK(read_weights(folder.path / "more.npz").tensors.empty());
  CHECK(holds(error_of([&] { read_weights(folder.path / "README"); }), "found something else"));
  CHECK(holds(error_of([&] { read_weights(folder.path / "none"); }), "found no file"));
}
