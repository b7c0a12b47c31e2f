// See photo_crops.h.
#include "models/eval/photo_crops.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <set>

#include "models/io/host_random.h"
#include "models/io/json.h"
#include "models/io/paths.h"
#include "models/scene/asset_class.h"
#include "models/scene/box_projection.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr char kCropIndex[] = "crops.json";
constexpr double kMostCovered = 0.1;  // of the 2-D box
constexpr int kRounding = 1;          // pixels of the photo that bounds may be off
constexpr double kMargin = 0.05;      // of a crop, on each side, of the longer side of the bounds
constexpr int kMostPixels = 4096;

int class_of(const std::string& name, const std::string& where) {
  const auto* found = std::find(std::begin(kAssetClasses), std::end(kAssetClasses), name);
  if (found == std::end(kAssetClasses)) bad_data(where, ": \"class\" is ", name, ", which is none of Table A1");
  return static_cast<int>(found - std::begin(kAssetClasses));
}

std::vector<double> numbers(const Json& object, const std::string& key, std::size_t count, const std::string& where) {
  std::vector<double> values;
  for (const Json& value : array(object, key, where))
    values.push_back(value.is_number() ? value.get<double>() : std::numeric_limits<double>::quiet_NaN());
  const auto is_finite = [](double value) { return std::isfinite(value); };
  if (values.size() != count || !std::all_of(values.begin(), values.end(), is_finite))
    bad_data(where, ": \"", key, "\" is not a list of ", count, " numbers");
  return values;
}

Camera camera_of(const Json& crop, int size, const std::string& where) {
  const Json& lens = member(crop, "intrinsics", where);
  Camera camera;
  camera.width = camera.height = size;
  camera.fx = number(lens, "fx", where), camera.fy = number(lens, "fy", where);
  camera.cx = number(lens, "cx", where), camera.cy = number(lens, "cy", where);
  if (camera.fx <= 0 || camera.fy <= 0) bad_data(where, ": fx and fy must be above 0");
  return camera;
}

/// Whether the bounds in the photo, which end at its edges, are those of the whole box.
bool is_whole(const PhotoCrop& crop, const Json& entry, const std::string& where) {
  const std::vector<double> box = numbers(entry, "box", 4, where), square = numbers(entry, "square", 4, where);
  const double side = square[2] - square[0], scale = side / crop.camera.width;
  if (side < 1 || side > kMostPixels)
    bad_data(where, ": \"square\" is ", side, " pixels wide, want 1 to ", kMostPixels);
  // The camera of the photo, with a square of room on all sides of the crop's.
  Camera wide = crop.camera;
  wide.width = wide.height = static_cast<int>(3 * side);
  wide.fx *= scale, wide.fy *= scale;
  wide.cx = wide.cx * scale + side, wide.cy = wide.cy * scale + side;
  const auto bounds = bounds_in_image(wide, crop.box_from_camera.inverse(), crop.size);
  if (!bounds) return false;
  const double found[] = {bounds->left + square[0] - side, bounds->top + square[1] - side,
                          bounds->right + square[0] - side, bounds->bottom + square[1] - side};
  for (std::size_t i = 0; i < 4; ++i)
    if (std::abs(found[i] - box[i]) > kRounding) return false;
  return true;
}

struct Read {
  PhotoCrop crop;
  bool counts;
};

Read read_crop(const fs::path& folder, const Json& entry, int size, const std::string& where) {
  PhotoCrop crop;
  crop.file = folder / path_named(folder, string(entry, "file", where), false);
  crop.log = string(entry, "log", where);
  crop.asset_class = class_of(string(entry, "class", where), where);
  crop.night = flag(entry, "night", false, where);
  const std::vector<double> sides = numbers(entry, "size_m", 3, where);
  crop.size = Eigen::Vector3d(sides[0], sides[1], sides[2]);
  if (crop.size.minCoeff() <= 0) bad_data(where, ": \"size_m\" must be above 0");
  crop.box_from_camera = matrix4(entry, "box_from_camera", where);
  crop.camera = camera_of(entry, size, where);
  const bool is_cut_out = string(entry, "mask", where) == "file";
  const bool is_free = number(entry, "covered", where) < kMostCovered;
  return {crop, is_cut_out && is_free && is_whole(crop, entry, where)};
}

}  // namespace

PhotoCrops read_photo_crops(const fs::path& folder) {
  const fs::path path = folder / kCropIndex;
  if (!fs::exists(path))
    bad_data(folder.string(), ": found no ", kCropIndex, "\n  fix: cloam crops LOG... -o DIR --size 64, and name DIR");
  const Json index = parse_json_file(path);
  PhotoCrops photos;
  const double size = number(index, "size", path.string());
  if (size < 1 || size > kMostPixels || size != std::floor(size))
    bad_data(path.string(), ": \"size\" is ", size, ", want pixels a side from 1 to ", kMostPixels);
  photos.size = static_cast<int>(size);
  for (const Json& entry : array(index, "crops", path.string())) {
    const std::string where = text(path.string(), ", crop ", photos.crops.size() + photos.left_out);
    const Read read = read_crop(folder, entry, photos.size, where);
    if (read.counts)
      photos.crops.push_back(read.crop);
    else
      ++photos.left_out;
  }
  if (photos.crops.size() >= 2) return photos;
  bad_data(path.string(), ": ", photos.crops.size(), " of ", photos.crops.size() + photos.left_out,
           " crops show all of an actor (cut by a mask, less than a tenth covered, all in the image), want two or more",
           "\n  fix: crops of more logs, or, where these have no masks, cloam crops LOG... --masks MASKS -o DIR");
}

std::vector<bool> held_out_crops(const PhotoCrops& photos, uint64_t seed) {
  std::set<std::string> names;
  for (const PhotoCrop& crop : photos.crops) names.insert(crop.log);
  if (names.size() < 3)
    bad_data("the crops are of ", names.size(), " logs, want three or more: classes are learned from two at least and ",
             "measured on another\n  fix: cloam crops LOG LOG LOG... -o DIR");
  std::vector<std::string> order(names.begin(), names.end());
  HostRandom random(seed);
  for (std::size_t i = order.size() - 1; i > 0; --i) std::swap(order[i], order[random.below(i + 1)]);
  order.resize(std::max<std::size_t>(1, order.size() / 4));
  std::vector<bool> held_out;
  for (const PhotoCrop& crop : photos.crops)
    held_out.push_back(std::find(order.begin(), order.end(), crop.log) != order.end());
  return held_out;
}

Camera framed(Camera camera, const Eigen::Matrix4d& box_from_camera, const Eigen::Vector3d& size) {
  const Eigen::Matrix4d camera_from_box = box_from_camera.inverse();
  Eigen::Array2d least = Eigen::Array2d::Constant(std::numeric_limits<double>::infinity()), most = -least;
  for (int corner = 0; corner < 8; ++corner) {
    const Eigen::Vector3d sides((corner & 1) - 0.5, (corner >> 1 & 1) - 0.5, (corner >> 2 & 1) - 0.5);
    const Eigen::Vector3d at = (camera_from_box * sides.cwiseProduct(size).homogeneous()).head<3>();
    least = least.min(at.head<2>().array() / at.z());
    most = most.max(at.head<2>().array() / at.z());
  }
  const double side = (most - least).maxCoeff() * (1 + 2 * kMargin);
  const Eigen::Array2d middle = (least + most) / 2;
  camera.fx = camera.fy = camera.width / side;
  camera.cx = camera.width / 2.0 - camera.fx * middle.x();
  camera.cy = camera.height / 2.0 - camera.fy * middle.y();
  return camera;
}

Eigen::Matrix4d pose_for(const Eigen::Vector3d& asset, const PhotoCrop& photo) {
  Eigen::Matrix4d pose = photo.box_from_camera;
  pose.topRightCorner<3, 1>() *= asset.norm() / photo.size.norm();
  return pose;
}

}  // namespace cloam
