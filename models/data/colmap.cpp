// See colmap.h.
#include "models/data/colmap.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <unordered_map>

#include "models/data/colmap_model.h"
#include "models/data/llff.h"
#include "models/data/photos.h"
#include "models/io/paths.h"
#include "models/io/safetensors_header.h"  // printable
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr double kFarthestPoint = 1e7;  // beyond it float32 has no use left
constexpr const char* kModelFolders[] = {"sparse/0", "sparse", ""};

/// Empty if there is none.
fs::path model_folder(const fs::path& root) {
  for (const char* folder : kModelFolders) {
    if (has_colmap_model(root / folder)) return root / folder;
  }
  return {};
}

bool is_point(const ColmapPoint& point) {
  return point.track > 0 && point.position.allFinite() && point.position.cwiseAbs().maxCoeff() < kFarthestPoint;
}

class ColmapReader {
 public:
  ColmapReader(const fs::path& root, const ReadOptions& options)
      : options_(options), folder_(model_folder(root)), model_(read_colmap_model(folder_)) {
    scene_.root = root;
    scene_.format = "COLMAP";
    scene_.up = -Eigen::Vector3d::UnitY();  // COLMAP's habit: the first camera stands upright
    std::error_code error;
    images_ = fs::is_directory(root / "images", error) ? "images" : "";
  }

  Scene read() {
    std::sort(model_.images.begin(), model_.images.end(),
              [](const ColmapImage& a, const ColmapImage& b) { return a.name < b.name; });
    scene_.frames_listed = model_.images.size();
    for (const ColmapImage& image : model_.images) {
      guarded(options_.skip_bad, scene_.warnings, "frame dropped",
              [&] { read_image(image, folder_.string() + ", image " + printable(image.name)); });
    }
    warn_of_other_models();
    finish_photos(scene_, missing_, options_);
    read_points();
    scene_.up = mean_up(scene_);
    if (is_llff(scene_.root))  // LLFF's depths, in units of the model that its poses are from
      guarded(true, scene_.warnings, "depths left out", [&] { scene_.hints.nearest = llff_nearest(scene_.root); });
    return std::move(scene_);
  }

 private:
  void read_image(const ColmapImage& image, const std::string& where) {
    Frame frame;
    frame.name = image.name;
    frame.image = path_named(scene_.root, (fs::path(images_) / image.name).generic_string(), options_.allow_outside);
    frame.world_from_camera = world_from_camera(image, where);
    const auto camera = model_.cameras.find(image.camera);
    if (camera == model_.cameras.end())
      bad_data(where, ": refers to camera ", image.camera, ", which is not among the model's ", model_.cameras.size(),
               " cameras");
    if (!has_file(scene_.root / frame.image)) {
      missing_.push_back(frame.image);
      return;
    }
    frame.camera = find_or_add(scene_.cameras, camera->second);
    scene_.frames.push_back(std::move(frame));
  }

  void read_points() {
    for (const ColmapPoint& point : model_.points) {
      if (!is_point(point)) continue;
      for (const double place : point.position) scene_.cloud.positions.push_back(static_cast<float>(place));
      scene_.cloud.colours.insert(scene_.cloud.colours.end(), point.colour.begin(), point.colour.end());
    }
    const std::size_t left_out = model_.points.size() - scene_.cloud.count();
    if (left_out == 0) return;
    scene_.warnings.push_back(text(left_out, " of ", model_.points.size(),
                                   " points are left out: seen in no image, not finite, or farther away than ",
                                   kFarthestPoint));
  }

  // The mapper makes several where not all images hang together.
  void warn_of_other_models() {
    int others = 0;
    while (has_colmap_model(scene_.root / "sparse" / std::to_string(others + 1))) ++others;
    if (others == 0 || folder_ != scene_.root / "sparse/0") return;
    scene_.warnings.push_back(text("sparse/ has ", others + 1,
                                   " models, each of a part of the images; only sparse/0, with ", scene_.frames_listed,
                                   " images, is read"));
  }

  ReadOptions options_;
  fs::path folder_;
  ColmapModel model_;
  Scene scene_;
  std::string images_;
  std::vector<std::string> missing_;
};

}  // namespace

bool is_colmap(const fs::path& root) { return !model_folder(root).empty(); }

Scene read_colmap(const fs::path& root, const ReadOptions& options) { return ColmapReader(root, options).read(); }

std::string error_in_words(const ColmapFit& fit) {
  return fit.observations > 0 ? fmt::format("{:.2f} px", fit.mean_error) : "not known";
}

ColmapFit check_colmap(const fs::path& root) {
  const fs::path folder = model_folder(root);
  const ColmapModel model = read_colmap_model(folder, true);
  ColmapFit fit;
  std::unordered_map<std::uint64_t, Eigen::Vector3d> points;
  for (const ColmapPoint& point : model.points) {
    if (is_point(point)) points.emplace(point.id, point.position);
  }
  fit.points = points.size();
  for (const ColmapImage& image : model.images) {
    const auto camera = model.cameras.find(image.camera);
    if (camera == model.cameras.end()) continue;
    const Eigen::Matrix4d pose = world_from_camera(image, folder.string() + ", image " + printable(image.name));
    const Eigen::Isometry3d camera_from_world = Eigen::Isometry3d(pose).inverse();
    for (const ColmapObservation& seen : image.observations) {
      const auto point = points.find(seen.point);
      if (point == points.end()) continue;
      fit.mean_error += (project(camera->second, camera_from_world * point->second) - seen.pixel).norm();
      ++fit.observations;
    }
  }
  if (fit.observations > 0) fit.mean_error /= static_cast<double>(fit.observations);
  return fit;
}

}  // namespace cloam
