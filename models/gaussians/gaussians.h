// 3D Gaussians on the host, as files hold them and as `train splat` begins with them (Kerbl et al. 2023). Values are
// raw: what training changes, before exp, sigmoid and normalisation.
#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <vector>

namespace cloam {

constexpr int kSphericalBands = 3;                                                 // degree of the colours
constexpr int kSphericalRest = (kSphericalBands + 1) * (kSphericalBands + 1) - 1;  // without the first
constexpr double kSphericalFirst = 0.28209479177387814;                            // Y_0 = 1 / (2 sqrt(pi))

/// G gaussians. Colour seen along d: max(0, 0.5 + the sum of coefficients times harmonics of d), d from the eye to the
/// mean. World axes are those of the capture.
struct Gaussians {
  std::vector<float> means;      // [G,3], scene units
  std::vector<float> scales;     // [G,3], logarithms of deviations
  std::vector<float> rotations;  // [G,4], quaternion w, x, y, z of any length: world_from_gaussian
  std::vector<float> opacities;  // [G], logits
  std::vector<float> sh_first;   // [G,3], the coefficient of degree 0 of red, green, blue
  std::vector<float> sh_rest;    // [G,15,3], degrees 1 to 3 in 3DGS's order; zeros where the degree is lower
  Eigen::Vector3d up = Eigen::Vector3d::UnitZ();  // of the world; files that do not tell have -y (COLMAP's habit)
  bool metric = false;                            // true: one unit is one metre

  std::size_t count() const { return opacities.size(); }
};

/// The arrays, for what is done to all of them alike; width: numbers a gaussian.
struct GaussianArray {
  const char* name;
  std::vector<float> Gaussians::*values;
  std::size_t width;
};
constexpr GaussianArray kGaussianArrays[] = {
    {"means", &Gaussians::means, 3},         {"scales", &Gaussians::scales, 3},
    {"rotations", &Gaussians::rotations, 4}, {"opacities", &Gaussians::opacities, 1},
    {"sh_first", &Gaussians::sh_first, 3},   {"sh_rest", &Gaussians::sh_rest, 3 * kSphericalRest},
};

}  // namespace cloam
