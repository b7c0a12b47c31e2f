// A sparse model as COLMAP writes it, binary or text: cameras, images with poses, points. colmap.github.io/format.html
#pragma once
#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "models/scene/camera.h"

namespace cloam {

/// A point of the model as it was found in an image.
struct ColmapObservation {
  Eigen::Vector2d pixel;  // as Camera counts them: the centre of the first is (0.5, 0.5)
  std::uint64_t point = 0;
};

struct ColmapImage {
  std::string name;          // relative to the folder of the images; may hold folders and spaces
  std::uint32_t camera = 0;  // the id of one
  // camera_from_world, as stored; not checked.
  Eigen::Vector4d rotation;  // quaternion w, x, y, z
  Eigen::Vector3d translation;
  std::vector<ColmapObservation> observations = {};  // where they were asked for
};

struct ColmapPoint {
  std::uint64_t id = 0;
  Eigen::Vector3d position;  // not checked
  std::array<std::uint8_t, 3> colour = {};
  double error = 0;         // pixels, the mean over its track
  std::uint64_t track = 0;  // images that it was found in
};

struct ColmapModel {
  std::map<std::uint32_t, Camera> cameras;
  std::vector<ColmapImage> images;  // as listed
  std::vector<ColmapPoint> points;  // as listed; empty without a file of points
};

/// Whether the folder holds cameras and images of one kind, .bin or .txt. Never throws.
bool has_colmap_model(const std::filesystem::path& folder);

/// Binary files win over text. Lengths in a file are checked against its size before anything is allocated. Fault::data
/// that names file and place for files that are cut short or damaged, and for cameras that make no sense or have a
/// model that is not known here.
ColmapModel read_colmap_model(const std::filesystem::path& folder, bool observations = false);

/// world_from_camera, with `where` at the head of errors: Fault::data for what is no pose.
Eigen::Matrix4d world_from_camera(const ColmapImage& image, const std::string& where);

}  // namespace cloam
