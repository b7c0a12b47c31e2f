// Gaussian splatting as the papers write it, in float64 and without tiles: every gaussian at every pixel, in order of
// depth and number. What tests of the rasteriser compare with; it shares no code with it.
#pragma once
#include <Eigen/Dense>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

#include "models/scene/camera.h"

namespace cloam {

/// The 59 numbers of each gaussian in double, raw: mean 3, scale 3, rotation 4, opacity 1, first 3, rest 45.
using TwinRows = std::vector<Eigen::Matrix<double, 59, 1>>;

struct TwinView {
  Camera camera;
  Eigen::Matrix<double, 3, 4> camera_from_world;
  double near = 0.2, blur = 0.3;
  std::vector<Eigen::Vector2d> shifts = {};  // of each gaussian's mean in the picture, pixels; empty: none
};

struct TwinSplat {
  Eigen::Vector2d mean;
  Eigen::Matrix2d conic;
  Eigen::Vector3d colour;
  double opacity, depth;
};

/// The 16 real harmonics as 3DGS lists them.
inline std::array<double, 16> twin_harmonics(const Eigen::Vector3d& d) {
  const double x = d.x(), y = d.y(), z = d.z(), pi = M_PI;
  const double a = std::sqrt(15 / pi) / 2, b = std::sqrt(5 / pi) / 4, c = std::sqrt(35 / (2 * pi)) / 4;
  const double e = std::sqrt(105 / pi) / 2, f = std::sqrt(21 / (2 * pi)) / 4, g = std::sqrt(7 / pi) / 4;
  const double one = std::sqrt(3 / (4 * pi));
  return {1 / std::sqrt(4 * pi),
          -one * y,
          one * z,
          -one * x,
          a * x * y,
          -a * y * z,
          b * (3 * z * z - 1),
          -a * x * z,
          a / 2 * (x * x - y * y),
          -c * y * (3 * x * x - y * y),
          e * x * y * z,
          -f * y * (5 * z * z - 1),
          g * z * (5 * z * z - 3),
          -f * x * (5 * z * z - 1),
          e / 2 * z * (x * x - y * y),
          -c * x * (x * x - 3 * y * y)};
}

/// False where the gaussian is not in front of the near plane.
inline bool twin_project(const Eigen::Matrix<double, 59, 1>& row, const TwinView& view, TwinSplat& out) {
  const Eigen::Matrix3d w = view.camera_from_world.leftCols<3>();
  const Eigen::Vector3d mean = row.segment<3>(0), t = w * mean + view.camera_from_world.col(3);
  if (t.z() <= view.near) return false;
  const Eigen::Quaterniond q(row[6], row[7], row[8], row[9]);
  const Eigen::Matrix3d r = q.normalized().toRotationMatrix();
  const Eigen::Vector3d variances = (2 * row.segment<3>(3).array()).exp();
  const Eigen::Matrix3d sigma = r * variances.asDiagonal() * r.transpose();
  const Camera& c = view.camera;
  const double wide = 0.15 * c.width / c.fx, high = 0.15 * c.height / c.fy;
  const double u = std::clamp(t.x() / t.z(), -c.cx / c.fx - wide, (c.width - c.cx) / c.fx + wide);
  const double v = std::clamp(t.y() / t.z(), -c.cy / c.fy - high, (c.height - c.cy) / c.fy + high);
  Eigen::Matrix<double, 2, 3> j;
  j << c.fx / t.z(), 0, -c.fx / t.z() * u, 0, c.fy / t.z(), -c.fy / t.z() * v;
  const Eigen::Matrix2d covariance =
      j * w * sigma * w.transpose() * j.transpose() + view.blur * Eigen::Matrix2d::Identity();
  out.mean = {c.fx * t.x() / t.z() + c.cx, c.fy * t.y() / t.z() + c.cy};
  out.conic = covariance.inverse();
  out.opacity = 1 / (1 + std::exp(-row[10]));
  out.depth = t.z();
  const Eigen::Vector3d eye = -w.transpose() * view.camera_from_world.col(3);
  const std::array<double, 16> h = twin_harmonics((mean - eye).normalized());
  out.colour = Eigen::Vector3d::Constant(0.5) + h[0] * row.segment<3>(11);
  for (int k = 1; k < 16; k++) out.colour += h[static_cast<size_t>(k)] * row.segment<3>(14 + 3 * (k - 1));
  out.colour = out.colour.cwiseMax(0);
  return true;
}

/// [H,W,4]: red, green, blue on black, transmittance. Equal depths go by number. Depths are compared as float32, as
/// the rasteriser stores them.
inline std::vector<double> twin_render(const TwinRows& rows, const TwinView& view) {
  std::vector<TwinSplat> all;
  for (size_t i = 0; i < rows.size(); i++) {
    TwinSplat one;
    if (!twin_project(rows[i], view, one)) continue;
    if (!view.shifts.empty()) one.mean += view.shifts[i];
    all.push_back(one);
  }
  std::stable_sort(all.begin(), all.end(), [](const TwinSplat& a, const TwinSplat& b) {
    return static_cast<float>(a.depth) < static_cast<float>(b.depth);
  });
  std::vector<double> out;
  for (int y = 0; y < view.camera.height; y++) {
    for (int x = 0; x < view.camera.width; x++) {
      Eigen::Vector3d colour = Eigen::Vector3d::Zero();
      double through = 1;
      for (const TwinSplat& s : all) {
        const Eigen::Vector2d d = s.mean - Eigen::Vector2d(x + 0.5, y + 0.5);
        const double alpha = std::min(0.99, s.opacity * std::exp(-0.5 * d.dot(s.conic * d)));
        if (alpha < 1.0 / 255) continue;
        if (through * (1 - alpha) < 1e-4) break;
        colour += through * alpha * s.colour;
        through *= 1 - alpha;
      }
      out.insert(out.end(), {colour.x(), colour.y(), colour.z(), through});
    }
  }
  return out;
}

}  // namespace cloam
