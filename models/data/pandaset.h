// PandaSet's layout of a driving log: camera/NAME/ with images, intrinsics.json, poses.json and timestamps.json, lidar/
// and annotations/cuboids/ with pickled data frames. pandaset.org, github.com/scaleapi/pandaset-devkit
#pragma once
#include "models/data/reader.h"

namespace cloam {

constexpr const char* kPandasetCameras[] = {"front_camera", "front_left_camera", "front_right_camera",
                                            "left_camera",  "right_camera",      "back_camera"};

/// The files of a step are numbered with at least two digits: "07", "79", "100".
std::string pandaset_number(int step);

/// How cuboids have a box's turn, in radians: about the vertical, then about its own x (right) and y (forward).
/// PandaSet itself has only the first; the others are columns of ours, which a log without tilted boxes does not have.
struct CuboidTurn {
  double yaw = 0, pitch = 0, roll = 0;
};
CuboidTurn cuboid_turn(const Eigen::Matrix4d& world_from_box);
Eigen::Matrix3d rotation_of(const CuboidTurn& turn);

bool is_pandaset(const std::filesystem::path& root);
/// Any subset of the cameras will do, and LiDAR or cuboids may be absent. Images and frames that are missing are warned
/// of and skipped.
Scene read_pandaset(const std::filesystem::path& root, const ReadOptions& options);

}  // namespace cloam
