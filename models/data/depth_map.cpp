// See depth_map.h.
#include "models/data/depth_map.h"

#include <cmath>
#include <cstdlib>

#include "models/io/bytes.h"
#include "models/io/image.h"
#include "models/io/npy.h"
#include "models/io/words.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kLargestArray = std::uint64_t{1} << 30;  // bytes
constexpr double kMillimetre = 0.001;

bool is_kind(const fs::path& path, const char* extension) { return lower_case(path.extension().string()) == extension; }

FloatPlane read_npy_plane(const fs::path& path) {
  const std::vector<std::uint8_t> bytes = read_file(path, kLargestArray);
  NpyArray array = parse_npy(bytes, path.string());
  std::vector<std::uint64_t> shape = array.shape;
  if (shape.size() == 3 && shape.back() == 1) shape.pop_back();
  if (shape.size() != 2 || array.length() == 0)
    bad_data(path.string(), ": a depth map has the shape [height, width], this array has ", array.shape.size(),
             " axes; save one plane");
  return {static_cast<int>(shape[1]), static_cast<int>(shape[0]), npy_floats(array)};
}

FloatPlane read_png_plane(const fs::path& path) {
  const Labels labels = read_labels(path);
  return {labels.width, labels.height, {labels.values.begin(), labels.values.end()}};
}

/// COLMAP's: "WIDTH&HEIGHT&1&", then float32 by rows. colmap.github.io/format.html, "Depth and normal maps"
FloatPlane read_colmap_plane(const fs::path& path) {
  const std::vector<std::uint8_t> bytes = read_file(path, kLargestArray);
  ByteReader reader(bytes, path.string());
  int sizes[3] = {};
  for (int& size : sizes) {
    std::string digits;
    for (char next = 0; next != '&' && digits.size() < 8; digits += next)
      next = static_cast<char>(reader.little<std::uint8_t>("the header"));
    if (digits.back() == '&') size = number_in<int>(digits.substr(0, digits.size() - 1)).value_or(0);
  }
  const auto [width, height, channels] = sizes;
  if (width < 1 || height < 1 || channels != 1)
    bad_data(path.string(), ": is no depth map of COLMAP's: it does not begin with WIDTH&HEIGHT&1&");
  const std::uint64_t count = std::uint64_t(width) * std::uint64_t(height);
  if (reader.remaining() != count * sizeof(float))
    bad_data(path.string(), ": ", width, "x", height, " depths take ", count * sizeof(float), " bytes, found ",
             reader.remaining(), "; the file is damaged or truncated");
  FloatPlane plane{width, height, {}};
  plane.values.reserve(count);
  for (std::uint64_t i = 0; i < count; ++i) plane.values.push_back(reader.little<float>("a depth"));
  return plane;
}

FloatPlane read_plane(const fs::path& path) {
  if (is_kind(path, ".bin")) return read_colmap_plane(path);
  if (is_kind(path, ".npy")) return read_npy_plane(path);
  if (is_kind(path, ".exr")) return read_exr_layer(path, std::vector<std::string>{"Z", "Y", "R"});
  if (is_kind(path, ".png")) return read_png_plane(path);
  bad_data(path.string(), ": want a depth map as .png, .exr, .npy or COLMAP's .bin");
}

/// What the sensor was not sure of becomes 0.
void drop_guesses(FloatPlane& depth, const fs::path& path) {
  const Labels sure = read_labels(path);
  if (sure.width != depth.width || sure.height != depth.height)
    bad_data(path.string(), ": ", sure.width, "x", sure.height, " pixels, its depth map has ", depth.width, "x",
             depth.height, "; restore the file, or remove it to trust all depths");
  for (std::size_t i = 0; i < depth.values.size(); ++i)
    if (sure.values[i] < kLeastConfidence) depth.values[i] = 0;
}

/// Whether the sides have one ratio, within a pixel of the plane.
bool has_shape_of(const FloatPlane& plane, const DepthPhoto& photo) {
  const auto one = std::int64_t{plane.width} * photo.height, other = std::int64_t{plane.height} * photo.width;
  return std::abs(one - other) <= std::max(photo.width, photo.height);
}

FloatPlane upright(const FloatPlane& plane, int turn) {
  const bool on_its_side = turn >= 5;
  FloatPlane result{on_its_side ? plane.height : plane.width, on_its_side ? plane.width : plane.height, {}};
  for (const std::size_t place : upright_places(plane.width, plane.height, turn))
    result.values.push_back(plane.values[place]);
  return result;
}

/// The plane as the photo lies.
FloatPlane fitted(FloatPlane plane, const DepthPhoto& photo, const std::string& file) {
  if (!has_shape_of(plane, photo)) plane = upright(plane, photo.turn);  // stored as the photo is
  if (has_shape_of(plane, photo)) return plane;
  bad_data(file, ": a depth map of ", plane.width, "x", plane.height, " pixels for a photo of ", photo.width, "x",
           photo.height, ": the aspect ratio differs; give the map of this photo");
}

}  // namespace

double usual_depth_unit(const fs::path& file) { return is_kind(file, ".png") ? kMillimetre : 1; }

std::vector<float> depth_of(const fs::path& root, const DepthMap& map, const DepthPhoto& photo) {
  FloatPlane plane = read_plane(root / map.file);
  if (map.confidence) drop_guesses(plane, root / *map.confidence);
  plane = fitted(std::move(plane), photo, map.file);
  const Camera& camera = photo.camera;
  std::vector<float> depths;
  depths.reserve(static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height));
  // At 0.5 pixels from its corner a pixel's middle is a whole number of halves: no rounding decides which is nearest.
  const auto nearest = [&](int at, int side, int whole) {
    const std::int64_t place = (2 * std::int64_t{at} + 1) * photo.factor * side / (2 * std::int64_t{whole});
    return static_cast<std::size_t>(std::min<std::int64_t>(place, side - 1));
  };
  for (int row = 0; row < camera.height; ++row) {
    const std::size_t line = nearest(row, plane.height, photo.height) * static_cast<std::size_t>(plane.width);
    for (int column = 0; column < camera.width; ++column) {
      double depth = map.unit * plane.values[line + nearest(column, plane.width, photo.width)];
      if (map.along_ray && depth > 0) depth *= direction(camera, {column + 0.5, row + 0.5}).normalized().z();
      depths.push_back(std::isfinite(depth) && depth > 0 ? static_cast<float>(depth) : 0.f);
    }
  }
  return depths;
}

}  // namespace cloam
