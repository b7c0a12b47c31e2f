// A street small enough to train on within a test: a wall 30 m ahead of cameras that look along x, and what drives
// between. Photos are made up; LiDAR returns come from the wall alone.
#pragma once
#include <doctest/doctest.h>

#include <Eigen/Dense>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "models/data/load_images.h"
#include "models/data/load_sweep.h"
#include "models/scene/scene.h"
#include "models/street/street.h"
#include "models/train/capability.h"
#include "models/train/method.h"
#include "tests/models/folder.h"

namespace cloam {

constexpr double kToyWall = 30;

inline Eigen::Matrix4d toy_pose(double x, double y, double z) {
  Eigen::Matrix4d pose = Eigen::Matrix4d::Identity();
  pose.topRightCorner<3, 1>() << x, y, z;
  return pose;
}

/// Looks along x from (0, y, 1.5).
inline Eigen::Matrix4d toy_camera_pose(double y) {
  Eigen::Matrix4d pose = toy_pose(0, y, 1.5);
  pose.topLeftCorner<3, 3>() << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  return pose;
}

/// Stands at (x, y) for a second from time 0 on; its box touches the ground.
inline Actor toy_actor(const std::string& id, const Eigen::Vector3d& size, double x, double y) {
  Actor actor;
  actor.id = id;
  actor.label = "Car";
  actor.size = size;
  for (int step = 0; step < 11; ++step) actor.boxes.push_back({step, 0.1 * step, toy_pose(x, y, size.z() / 2)});
  return actor;
}

struct ToyOptions {
  int frames = 2, width = 32, height = 24;
  bool lidar = true;
};

/// The log without actors. Frames and sweeps are 0.1 s apart.
inline Scene toy_street(const std::filesystem::path& root, const ToyOptions& options = {}) {
  Scene scene;
  scene.root = root;
  scene.format = "toy";
  scene.is_log = scene.metric = true;
  const double w = options.width, h = options.height;
  scene.cameras = {{options.width, options.height, w, w, w / 2, h / 2}};
  for (int step = 0; step < options.frames; ++step) {
    Frame frame;
    frame.name = frame.image = std::to_string(step) + ".png";
    frame.timestamp = 0.1 * step;
    frame.world_from_camera = toy_camera_pose(0.2 * step);
    frame.sensor = "front_camera";
    frame.step = step;
    scene.frames.push_back(frame);
    if (!options.lidar) continue;
    std::ofstream file(root / (std::to_string(step) + ".bin"), std::ios::binary);
    for (double y = -20; y <= 20; y += 0.25)
      for (double z = 0; z <= 12; z += 0.25) {
        const float point[4] = {static_cast<float>(kToyWall), static_cast<float>(y), static_cast<float>(z), 0.5f};
        file.write(reinterpret_cast<const char*>(point), sizeof point);
      }
    scene.sweeps.push_back({std::to_string(step) + ".bin", 0.1 * step, toy_pose(0, 0, 2), step, Split::train, true});
  }
  return scene;
}

/// Colours that differ from pixel to pixel.
inline Pixels toy_pixels(const Scene& scene) {
  Pixels pixels;
  pixels.cameras = scene.cameras;
  for (std::size_t i = 0; i < scene.frames.size(); ++i) {
    const Camera& camera = scene.cameras[static_cast<std::size_t>(scene.frames[i].camera)];
    FramePixels photo{i, scene.frames[i].camera, camera.width, camera.height, {}, {}};
    for (int y = 0; y < camera.height; ++y)
      for (int x = 0; x < camera.width; ++x)
        for (const int value : {7 * x, 9 * y, 3 * x + 5 * y + 40 * static_cast<int>(i), 255})
          photo.rgba.push_back(static_cast<std::uint8_t>(value % 256));
    pixels.frames.push_back(photo);
  }
  return pixels;
}

/// The actors whose returns check_toy_returns() wants.
inline std::vector<Actor> toy_targets() {
  return {toy_actor("far", {2, 2, 2}, 20, 8), toy_actor("near", {2, 4, 3}, 12, 0)};
}

/// Rays from the LiDAR's place to the nearer target, to the wall, to the sky and to the farther target, in a street
/// that is solid in its boxes and occupied voxels.
inline void check_toy_returns(Method& method) {
  const std::vector<Eigen::Vector3d> ways = {{1, 0, 0}, {1, -0.4, 0.05}, {0.2, 0, 1}, {20, 8, -0.5}};
  WorldRays rays;
  rays.time = 0.2;
  for (const Eigen::Vector3d& way : ways)
    for (int k = 0; k < 3; ++k) {
      rays.origins.push_back(k == 2 ? 1.5f : 0.f);
      rays.directions.push_back(static_cast<float>(way.normalized()[k]));
    }
  const LidarReturns returns = as<Street>(method)->measure(rays);
  CHECK(returns.actors == std::vector<int>{2, 0, 0, 1});
  REQUIRE(returns.depths.size() == 4);
  CHECK(double{returns.depths[0]} == doctest::Approx(11 - 0.125).epsilon(0.01));
  const double wall = kToyWall * ways[1].norm();
  CHECK(std::abs(double{returns.depths[1]} - wall) < 0.4);  // a voxel and a step
  CHECK(returns.depths[2] == 0);                            // the sky
}

}  // namespace cloam
