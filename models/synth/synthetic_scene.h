// A small still life (a painted clay jar, blocks and balls on a round board) in the folder layout of the NeRF-synthetic
// scenes: the data that the demo and the tests make for themselves.
#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <vector>

namespace cloam {

struct SyntheticOptions {
  int train = 40, test = 8;  // numbers of views
  int size = 128;            // pixels a side
  uint64_t seed = 0;         // arrangement, colours and viewpoints
};

/// Writes train/r_N.png and test/r_N.png (RGBA, straight alpha) and transforms_train.json, transforms_test.json
/// (world_from_camera with OpenGL camera axes, z up). The scene lies within 1.34 of the origin, the cameras 4 away on
/// the upper half. Equal options give equal bytes. Errors: Fault::usage for sizes or counts below 1; Fault::write.
void write_synthetic_scene(const std::filesystem::path& folder, const SyntheticOptions& options);

/// The one-coloured balls of the scene of a seed, for checks of the geometry: linear RGB albedo.
struct SyntheticBall {
  Eigen::Vector3d centre;
  double radius = 0;
  Eigen::Vector3d colour;
};
std::vector<SyntheticBall> synthetic_balls(uint64_t seed);

}  // namespace cloam
