// Photographs of actors as `cloam crops` cuts them out: what renders of assets are held against, whatever made them.
#pragma once
#include <Eigen/Core>
#include <filesystem>
#include <string>
#include <vector>

#include "models/scene/camera.h"

namespace cloam {

struct PhotoCrop {
  std::filesystem::path file;
  std::string log;
  int asset_class = 0;  // of kAssetClasses
  bool night = false;
  Eigen::Vector3d size = Eigen::Vector3d::Zero();  // of its box, metres
  Eigen::Matrix4d box_from_camera = Eigen::Matrix4d::Identity();
  Camera camera;  // of the crop
};

struct PhotoCrops {
  int size = 0;  // pixels a side
  std::vector<PhotoCrop> crops;
  std::size_t left_out = 0;
};

/// The crops of a folder that show all of an actor, as an asset alone is shown: cut by a mask (outlines of boxes show
/// background), less than a tenth of the 2-D box behind nearer ones, and the whole box in the image. Fault::data for a
/// folder that is none of `cloam crops`, for a damaged one, and where less than two such crops are.
PhotoCrops read_photo_crops(const std::filesystem::path& folder);

/// Which of them belong to logs that are held out: one log in four, at least one, as the seed says. Fault::data for
/// less than three logs, of which two train.
std::vector<bool> held_out_crops(const PhotoCrops& photos, uint64_t seed);

/// The pinhole camera that sees a box as crops do: the longer side of its bounds and a twentieth more on each side fill
/// the picture. The box lies in front of the camera, which is given with its direction right.
Camera framed(Camera camera, const Eigen::Matrix4d& box_from_camera, const Eigen::Vector3d& size);

/// Where a camera stands to see an asset of another size as it saw a box: in the same direction, at a distance that
/// grows with the diagonal.
Eigen::Matrix4d pose_for(const Eigen::Vector3d& asset, const PhotoCrop& photo);

}  // namespace cloam
