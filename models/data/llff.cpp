// See llff.h. A row of poses_bounds.npy has 17 numbers: by rows a 3x5 matrix, whose columns are the camera's down,
// right and backward axes, its place, and height, width and focal length in pixels; then the depths of the nearest and
// of the farthest thing that the photo sees.
#include "models/data/llff.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "models/data/photos.h"
#include "models/data/poses.h"
#include "models/io/bytes.h"
#include "models/io/image.h"
#include "models/io/npy.h"
#include "models/io/paths.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr char kFile[] = "poses_bounds.npy";
constexpr char kMend[] = "\n  fix: write it again with LLFF's imgs2poses.py, from these images";
constexpr const char* kImageFolders[] = {"images", "images_2", "images_4", "images_8"};
constexpr std::size_t kNumbers = 17;
constexpr std::uint64_t kMostBytes = std::uint64_t{1} << 28;  // of a million photos
constexpr double kMostStretch = 0.02;                         // images made smaller have whole pixels

using Row = std::array<double, kNumbers>;

std::vector<std::string> images_in(const fs::path& folder) {
  std::vector<std::string> names;
  std::error_code error;
  fs::directory_iterator entry(folder, error);
  for (const fs::directory_iterator end; !error && entry != end; entry.increment(error))
    if (is_image_name(entry->path()) && entry->path().filename().string().front() != '.')
      names.push_back(entry->path().filename().string());
  std::sort(names.begin(), names.end());
  return names;
}

double nearest_of(const Row& row, const std::string& where) {
  const double near = row[15], far = row[16];
  if (!(near > 0 && far >= near && std::isfinite(far)))
    bad_data(where, ": looked for depths 0 < near <= far, found ", near, " and ", far, kMend);
  return near;
}

std::string shape_of(const NpyArray& array) {
  std::string shape;
  for (const std::uint64_t extent : array.shape) shape += (shape.empty() ? "" : ", ") + std::to_string(extent);
  return "(" + shape + ")";
}

std::vector<Row> read_rows(const fs::path& path) {
  const std::vector<std::uint8_t> bytes = read_file(path, kMostBytes);
  const NpyArray array = parse_npy(bytes, path.string());
  if (array.shape.size() != 2 || array.shape[1] != kNumbers || array.shape[0] == 0)
    bad_data(path.string(),
             ": looked for a row of 17 numbers a photo (a pose of 3x5 and two depths), shape (N, 17); found ",
             array.type, " of shape ", shape_of(array), kMend);
  std::vector<Row> rows(array.shape[0]);
  if (array.type != "<f8" || array.columns_first) {  // numpy.save of a changed array: the values are as good
    const std::vector<float> values = npy_floats(array);
    for (std::size_t i = 0; i < values.size(); ++i) rows[i / kNumbers][i % kNumbers] = values[i];
    return rows;
  }
  for (std::size_t i = 0; i < rows.size() * kNumbers; ++i)
    rows[i / kNumbers][i % kNumbers] = number_at<double>(array.content.data() + i * sizeof(double));
  return rows;
}

class LlffReader {
 public:
  LlffReader(const fs::path& root, const ReadOptions& options) : options_(options) {
    scene_.root = root;
    scene_.format = "LLFF";
  }

  Scene read() {
    const std::vector<Row> rows = read_rows(scene_.root / kFile);
    find_images();
    if (images_.size() != rows.size())
      bad_data(
          scene_.root.string(), ": ", kFile, " has ", rows.size(), " poses, ", folder_, "/ has ", images_.size(),
          " images (.png, .jpg, .exr)\n  fix: put back the images that the poses were found of, or find them again");
    scene_.frames_listed = rows.size();
    for (std::size_t i = 0; i < rows.size(); ++i) {
      guarded(options_.skip_bad, scene_.warnings, "frame dropped",
              [&] { read_frame(rows[i], images_[i], text(kFile, ", row ", i, " (", images_[i], ")")); });
    }
    finish_photos(scene_, {}, options_);
    scene_.up = mean_up(scene_);
    return std::move(scene_);
  }

 private:
  void find_images() {
    for (const char* folder : kImageFolders) {
      folder_ = folder;
      images_ = images_in(scene_.root / folder);
      if (!images_.empty()) return;
    }
    bad_data(scene_.root.string(), ": ", kFile,
             " is there, its images are not: looked for images/, images_2/, images_4/ and ",
             "images_8/ with .png, .jpg or .exr files in them\n  fix: put the images that the poses were found of into "
             "images/");
  }

  void read_frame(const Row& row, const std::string& image, const std::string& where) {
    const Eigen::Map<const Eigen::Matrix<double, 3, 5, Eigen::RowMajor>> matrix(row.data());
    if (!matrix.allFinite()) bad_data(where, ": a number of the pose is not finite", kMend);
    const double near = nearest_of(row, where);
    Frame frame;
    frame.name = frame.image = folder_ + "/" + image;
    if (!has_file(scene_.root / frame.image)) bad_data(where, ": the image is a link to a missing file");
    Eigen::Matrix4d pose = Eigen::Matrix4d::Identity();
    pose.topLeftCorner<3, 3>() << matrix.col(1), matrix.col(0), -matrix.col(2);
    pose.topRightCorner<3, 1>() = matrix.col(3);
    frame.world_from_camera = rigid(pose, where);
    frame.camera = find_or_add(scene_.cameras, camera_of(matrix.col(4), scene_.root / frame.image, where));
    scene_.frames.push_back(std::move(frame));
    scene_.hints.nearest = std::min(near, scene_.hints.nearest.value_or(near));
  }

  /// size: height, width and focal length of the photos that the poses were found of; these may be smaller ones.
  static Camera camera_of(const Eigen::Vector3d& size, const fs::path& image, const std::string& where) {
    const ImageSize pixels = read_image_size(image);
    const double across = pixels.width / size[1], down = pixels.height / size[0];
    if (!(size.minCoeff() > 0) || !(std::abs(across / down - 1) < kMostStretch))
      bad_data(where, ": the pose is of an image of ", size[1], "x", size[0], " pixels and focal length ", size[2],
               "; found ", pixels.width, "x", pixels.height,
               ", another shape\n  fix: use the images that the poses were found of, whole");
    Camera camera;
    camera.width = pixels.width;
    camera.height = pixels.height;
    camera.fx = size[2] * across;
    camera.fy = size[2] * down;
    camera.cx = 0.5 * pixels.width;
    camera.cy = 0.5 * pixels.height;
    require_sound(camera, where);
    return camera;
  }

  ReadOptions options_;
  Scene scene_;
  std::string folder_;
  std::vector<std::string> images_;
};

}  // namespace

bool is_llff(const fs::path& root) { return is_file(root / kFile); }

double llff_nearest(const fs::path& root) {
  double nearest = std::numeric_limits<double>::infinity();
  for (const Row& row : read_rows(root / kFile)) nearest = std::min(nearest, nearest_of(row, (root / kFile).string()));
  return nearest;
}

Scene read_llff(const fs::path& root, const ReadOptions& options) { return LlffReader(root, options).read(); }

}  // namespace cloam
