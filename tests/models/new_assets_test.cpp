// Generated assets on disk: what is written is read, and what no asset can have is told.
#include "models/latents/new_assets.h"

#include <doctest/doctest.h>

#include <cstring>
#include <functional>

#include "models/io/safetensors.h"
#include "runtime/error.h"
#include "tests/models/folder.h"

using namespace cloam;

namespace {

NewAssets two_assets() {
  NewAssets all{{}, {2, 3}, {{"asset.0", "by hand"}}};
  for (int i = 0; i < 2; ++i) {
    NewAsset asset{2 * i, i == 1, {2, 4.5, 1.5 + i}, std::vector<float>(18)};
    for (size_t k = 0; k < asset.code.size(); ++k) asset.code[k] = static_cast<float>(k) - 3 * static_cast<float>(i);
    all.assets.push_back(asset);
  }
  return all;
}

template <class Value>
void put(SafetensorsFile& file, const char* name, size_t at, Value value) {
  std::memcpy(file.tensors.at(name).data.data() + at * sizeof value, &value, sizeof value);
}

}  // namespace

TEST_CASE("generated assets are read as they were written") {
  const Folder folder;
  const NewAssets want = two_assets();
  write_new_assets(folder.path / "a", want);
  const NewAssets got = read_new_assets(folder.path / "a");
  CHECK(got.shape == want.shape);
  CHECK(got.made == want.made);
  REQUIRE(got.assets.size() == 2);
  for (size_t i = 0; i < 2; ++i) {
    CHECK(got.assets[i].asset_class == want.assets[i].asset_class);
    CHECK(got.assets[i].night == want.assets[i].night);
    CHECK(got.assets[i].size == want.assets[i].size);
    CHECK(got.assets[i].code == want.assets[i].code);
  }
}

TEST_CASE("generated assets that cannot be are one error with the file's name") {
  const Folder folder;
  write_new_assets(folder.path / "a", two_assets());
  const std::function<void(SafetensorsFile&)> damages[] = {
      [](SafetensorsFile& f) { put(f, "sizes", 4, -1.f); },
      [](SafetensorsFile& f) { put(f, "sizes", 4, 1e6f); },
      [](SafetensorsFile& f) { put(f, "classes", 0, int64_t{9}); },
      [](SafetensorsFile& f) { put(f, "classes", 1, int64_t{-1}); },
      [](SafetensorsFile& f) { put(f, "nights", 1, int64_t{2}); },
      [](SafetensorsFile& f) { f.tensors.erase("sizes"); },
      [](SafetensorsFile& f) { f.tensors.erase("latents"); },
      [](SafetensorsFile& f) {
        f.tensors.at("sizes").shape = {3, 2};
      },
      [](SafetensorsFile& f) {
        f.tensors.at("latents").shape = {2, 18};
      },
      [](SafetensorsFile& f) {
        f.tensors.at("latents").shape = {2, 3, 3, 2};
      },
      [](SafetensorsFile& f) { f.tensors.at("nights") = f.tensors.at("sizes"); },
  };
  for (const auto& damage : damages) {
    SafetensorsFile file = read_safetensors(folder.path / "a");
    damage(file);
    write_safetensors(folder.path / "b", file);
    try {
      (void)read_new_assets(folder.path / "b");
      FAIL_CHECK("no error");
    } catch (const Error& error) {
      CHECK(error.fault() == Fault::data);
      CHECK(std::string(error.what()).find((folder.path / "b").string()) != std::string::npos);
    }
  }
}
