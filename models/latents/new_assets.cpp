// See new_assets.h.
#include "models/latents/new_assets.h"

#include <algorithm>
#include <cmath>

#include "models/io/tensors.h"
#include "models/scene/asset_class.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr float kLargest = 1000;  // metres

bool can_be(const NewAsset& asset, int64_t asset_class, int64_t night) {
  const auto is_finite = [](float value) { return std::isfinite(value); };
  return asset_class >= 0 && asset_class < kAssetClassCount && (night == 0 || night == 1) &&
         asset.size.minCoeff() > 0 && asset.size.maxCoeff() < double{kLargest} &&
         std::all_of(asset.code.begin(), asset.code.end(), is_finite);
}

NewAssets assets_in(const SafetensorsFile& file) {
  const auto latents = file.tensors.find("latents");
  if (latents == file.tensors.end() || latents->second.shape.size() != 4)
    throw Error(Fault::data, "there is no tensor latents of shape N x channels x side x side");
  const std::vector<int64_t>& shape = latents->second.shape;
  const int64_t count = shape[0];
  NewAssets out{{}, {shape[1], shape[2]}, file.metadata};
  const auto codes = values_from<float>(file.tensors, "latents", {count, shape[1], shape[2], shape[2]});
  const auto sizes = values_from<float>(file.tensors, "sizes", {count, 3});
  const auto classes = values_from<int64_t>(file.tensors, "classes", {count});
  const auto nights = values_from<int64_t>(file.tensors, "nights", {count});
  const auto numbers = static_cast<std::ptrdiff_t>(count > 0 ? codes.size() / static_cast<size_t>(count) : 0);
  for (std::ptrdiff_t i = 0; i < count; ++i) {
    const auto at = static_cast<size_t>(i);
    NewAsset asset;
    asset.size = Eigen::Map<const Eigen::Vector3f>(&sizes[3 * at]).cast<double>();
    asset.code.assign(codes.begin() + i * numbers, codes.begin() + (i + 1) * numbers);
    if (!can_be(asset, classes[at], nights[at]))
      throw Error(Fault::data, text("asset ", i, " has a size or code that is out of range"));
    asset.asset_class = static_cast<int>(classes[at]);
    asset.night = nights[at] == 1;
    out.assets.push_back(std::move(asset));
  }
  return out;
}

}  // namespace

void AssetArrays::add(const NewAsset& asset) {
  latents_.insert(latents_.end(), asset.code.begin(), asset.code.end());
  classes_.push_back(asset.asset_class);
  nights_.push_back(asset.night ? 1 : 0);
  for (int k = 0; k < 3; ++k) sizes_.push_back(static_cast<float>(asset.size[k]));
}

void AssetArrays::write(const std::filesystem::path& path, const std::map<std::string, std::string>& made) const {
  const auto count = static_cast<int64_t>(classes_.size());
  SafetensorsFile file;
  file.tensors["latents"] = named_floats(latents_, {count, shape_[0], shape_[1], shape_[1]});
  file.tensors["sizes"] = named_floats(sizes_, {count, 3});
  file.tensors["classes"] = named_integers(classes_);
  file.tensors["nights"] = named_integers(nights_);
  file.metadata = made;
  write_safetensors(path, file);
}

void write_new_assets(const std::filesystem::path& path, const NewAssets& all) {
  AssetArrays arrays(all.shape);
  for (const NewAsset& asset : all.assets) arrays.add(asset);
  arrays.write(path, all.made);
}

NewAssets read_new_assets(const std::filesystem::path& path) {
  const SafetensorsFile file = read_safetensors(path);
  try {
    return assets_in(file);
  } catch (const Error& error) { throw Error(error.fault(), text(path.string(), ": ", error.what())); }
}

}  // namespace cloam
