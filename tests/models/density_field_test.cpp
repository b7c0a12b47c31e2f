// Radiance fields asked at places of the world, against what their pictures show along rays.
#include <doctest/doctest.h>

#include <Eigen/Geometry>
#include <cmath>

#include "models/data/read_scene.h"
#include "models/mesh/has_density.h"
#include "models/synth/synthetic_scene.h"
#include "runtime/ops.h"
#include "tests/models/folder.h"
#include "tests/models/worlds.h"

using namespace cloam;

namespace {

constexpr int kParts = 400;  // of a way that is summed over

/// Along every 17th pixel's ray of a view, the mean of |opacity by the densities - opacity of the picture|, and the
/// spread of the latter.
struct Agreement {
  double apart = 0, least = 1, most = 0;
};

Agreement agreement(Method& method, const View& view, double farthest) {
  const DensityField field = as<HasDensity>(method)->density_field();
  const Picture picture = shown(method, view);
  const std::vector<float> directions = pixel_directions(view.camera);
  const Eigen::Vector3d eye = view.world_from_camera.topRightCorner<3, 1>();
  Agreement out;
  int rays = 0;
  for (size_t i = 0; i < picture.opacity.size(); i += 17) {
    const Eigen::Vector3d way = (view.world_from_camera.topLeftCorner<3, 3>() *
                                 Eigen::Map<const Eigen::Vector3f>(&directions[3 * i]).cast<double>())
                                    .normalized();
    std::vector<float> points;
    std::vector<double> lengths;
    for (int k = 0; k < kParts; ++k) {  // by the square, since what is near matters in a contracted space
      const double begin = farthest * k * k / kParts / kParts, end = farthest * (k + 1) * (k + 1) / kParts / kParts;
      const Eigen::Vector3d at = eye + (begin + end) / 2 * way;
      lengths.push_back(field.subject.contains(at) || farthest > 20 ? end - begin : 0);
      for (const double value : at) points.push_back(static_cast<float>(value));
    }
    const std::vector<float> densities = field.densities(points);
    double lost = 0;
    for (size_t k = 0; k < densities.size(); ++k) lost += static_cast<double>(densities[k]) * lengths[k];
    const double seen = static_cast<double>(picture.opacity[i]);
    out.apart += std::abs(1 - std::exp(-lost) - seen);
    out.least = std::min(out.least, seen);
    out.most = std::max(out.most, seen);
    ++rays;
  }
  out.apart /= rays;
  return out;
}

/// Parameters become random, so that densities differ from place to place.
void stir(Method& method, const std::string& name, float spread) {
  uint32_t stream = 0;
  for (auto& [key, tensor] : method.parameters())
    if (key.find(name) != std::string::npos)
      assign({{tensor, (random_uniform(tensor.shape(), {5, 0, stream++}) - 0.5f) * spread}});
}

}  // namespace

TEST_CASE("densities of the world are those that pictures are made of, in a box and in a contracted space") {
  const Folder folder;
  write_synthetic_scene(folder.path / "data", {6, 1, 16, 3});
  Scene boxed = read_scene(folder.path / "data"), open = boxed;
  open.hints.synthetic_bounds = false;
  for (Frame& frame : open.frames) frame.world_from_camera.block<3, 1>(0, 3) += Eigen::Vector3d(1, -2, 0.5);
  struct Row {
    const char* method;
    const Scene& scene;
    const char* stirred;
    double farthest, most_apart;
  };
  for (const Row& row : {Row{"nerf", boxed, "grid", 8, 0.001}, Row{"nerf", open, "grid", 250, 0.015},
                         Row{"zipnerf", boxed, "nothing", 8, 0.015}}) {
    CAPTURE(row.method);
    CAPTURE(row.farthest);
    Settings settings = small_settings(row.method);
    if (std::string(row.method) == "nerf") settings.push_back({"march.min_step", "0.01"});
    const auto method = configured(row.method, settings);
    method->build({row.scene}, 3);
    stir(*method, row.stirred, row.farthest > 20 ? 2 : 6);
    const Frame& frame = row.scene.frames[2];
    const Agreement found =
        agreement(*method, view_of(frame, row.scene.cameras[static_cast<size_t>(frame.camera)], 0), row.farthest);
    MESSAGE(row.method, " ", found.apart, " of opacities from ", found.least, " to ", found.most);
    CHECK(found.apart < row.most_apart);
    CHECK(found.most > found.least + 0.04);
    CHECK(found.most < 0.99);  // or nothing could be told
  }
}
