// Files of weights: .npz as numpy writes it, and what becomes of a path that holds something else.
#include "models/io/weights.h"

#include <doctest/doctest.h>

#include <cstring>
#include <fstream>

#include "models/io/gzip.h"
#include "models/io/npz.h"
#include "runtime/error.h"
#include "tests/models/errors.h"
#include "tests/models/folder.h"

using namespace cloam;

namespace {

namespace fs = std::filesystem;
using Bytes = std::vector<std::uint8_t>;

void put(const fs::path& path, const Bytes& bytes) {
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
}

void add(Bytes& to, std::uint64_t value, int size) {
  for (int i = 0; i < size; i++) to.push_back(static_cast<std::uint8_t>(value >> 8 * i));
}
void add(Bytes& to, const Bytes& more) { to.insert(to.end(), more.begin(), more.end()); }
void add(Bytes& to, const std::string& more) { to.insert(to.end(), more.begin(), more.end()); }

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

struct Member {
  std::string name;
  Bytes content;
  bool deflated = false;
  std::uint32_t claimed = 0;  // another size than the true one, in the directory
};

/// A zip as numpy makes it: sizes of local headers are those of zip64, so that only the directory can be believed.
Bytes zip(const std::vector<Member>& members) {
  Bytes all, directory;
  for (const Member& m : members) {
    const Bytes packed = gzip(m.content);  // 10 bytes of header, deflate, checksum and size
    const Bytes raw = m.deflated ? Bytes(packed.begin() + 10, packed.end() - 8) : m.content;
    std::uint32_t checksum = 0;
    std::memcpy(&checksum, packed.data() + packed.size() - 8, 4);
    const auto offset = all.size();
    Bytes common;
    add(common, 20, 2), add(common, 0, 2), add(common, m.deflated ? 8 : 0, 2), add(common, 0, 4),
        add(common, checksum, 4);
    add(all, 0x04034b50, 4), add(all, common), add(all, 0xffffffffffffffff, 8), add(all, m.name.size(), 2);
    add(all, 4, 2), add(all, m.name), add(all, 1, 4), add(all, raw);
    add(directory, 0x02014b50, 4), add(directory, 20, 2), add(directory, common), add(directory, raw.size(), 4);
    add(directory, m.claimed ? m.claimed : m.content.size(), 4), add(directory, m.name.size(), 2),
        add(directory, 0, 12);
    add(directory, offset, 4), add(directory, m.name);
  }
  const auto offset = all.size();
  add(all, directory), add(all, 0x06054b50, 4), add(all, 0, 4);
  add(all, members.size(), 2), add(all, members.size(), 2), add(all, directory.size(), 4), add(all, offset, 4),
      add(all, 0, 2);
  return all;
}

const std::vector<float> kValues = {1, 2, 3, 4, 5, 6};

Bytes sound() { return zip({{"a.weight.npy", npy("2, 3", kValues), true}, {"b/bias.npy", npy("1,", {7})}}); }

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
  put(path, zip({{"a.npy", npy("6,", kValues), true, 4000000000u}}));
  CHECK(holds(error_of([&] { read_npz(path); }), "unpack to 4000000000"));
  put(path, zip({{"a.npy", npy("6,", kValues), true, 10000000u}}));
  CHECK(holds(error_of([&] { read_npz(path); }), "does not unpack to 10000000"));
  put(path, zip({{"a.npy", npy("6,", kValues)}, {"a.npy", npy("6,", kValues)}}));
  CHECK(holds(error_of([&] { read_npz(path); }), "twice"));
  put(path, zip({{"a.txt", npy("6,", kValues)}}));
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
