// Normalised scene coordinates: where the subject lies, in [-1,1]^3.
#pragma once
#include <Eigen/Geometry>

#include "models/scene/scene.h"

namespace cloam {

/// normalised = turn * (world - centre) * scale. contract: what lies outside [-1,1]^3 is folded into the shell up to
/// [-2,2]^3. ndc: fields live in ndc_points of it; the near plane is z = 1.
struct SceneFrame {
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  double scale = 1;
  bool contract = false;
  bool ndc = false;
  Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();
  Eigen::Vector2d widen = Eigen::Vector2d::Ones();  // ndc: x and y of what cameras see come to [-1,1] by it
};

/// Object scenes keep their box [-1.5,1.5]^3. Others: centre = the point nearest to all optical axes, scale = 1 over
/// the cameras' mean distance from it, contracted.
SceneFrame fit_scene(const Scene& scene);

/// The same, but in driving logs 1 is about the length of the path. Cameras that drive along a street do not look at a
/// common point; the one nearest to their axes is in the middle of the path, and most of the street beyond the cube.
SceneFrame fit_path(const Scene& scene);

/// [-1,1]^3 of a frame without ndc, in the world.
Eigen::AlignedBox3d box_of(const SceneFrame& frame);

/// The cameras' mean distance from the point nearest to all optical axes, in scene units; 1 where they are all there.
double viewing_distance(const Scene& scene);

/// Whether the capture says how far its nearest thing is, and its photos all look one way.
bool fits_ndc(const Scene& scene);

/// Normalised device coordinates of a forward-facing capture: the axes of the mean camera, the near plane at three
/// quarters of the distance of the nearest thing (`nearest`, in scene units; 0: what the capture says, or its points),
/// at least in front of all cameras. Fault::usage for cameras that do not look one way, or where nothing says how far
/// the nearest thing is.
SceneFrame fit_ndc(const Scene& scene, double nearest);

}  // namespace cloam
