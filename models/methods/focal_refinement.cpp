// See focal_refinement.h.
#include "models/methods/focal_refinement.h"

#include <cmath>

#include "runtime/error.h"
#include "runtime/ops.h"

namespace cloam {
namespace {

constexpr char kFocals[] = "intrinsics.log_focals", kFocalGroup[] = "intrinsics.";
// As those of poses: at first a scene says nothing about them.
constexpr float kFocalFinalRate = 0.01f;
constexpr int kFocalWarmUp = 200;  // steps

}  // namespace

void bind_focals(Config& c, FocalSettings& o) {
  c.bind("intrinsics.refine", o.refine, "learn the focal lengths of the cameras, which begin as given");
  c.bind("intrinsics.rate", o.rate, "intrinsics: learning rate of the logarithms of focal lengths");
}

void FocalRefinement::build(const FocalSettings& settings, const Scene& scene, Params& parameters,
                            const std::string& prefix) {
  settings_ = settings;
  prefix_ = prefix;
  if (!settings.refine) return;
  for (const Camera& camera : scene.cameras)
    if (camera.model == CameraModel::fisheye || camera.model == CameraModel::fov)
      throw Error(
          Fault::usage,
          "setting intrinsics.refine: looked for pinholes and OpenCV lenses, found a fisheye or FOV lens, whose "
          "focal length is learned by none\n  fix: leave it out, or, of a capture, undistort the photos with `colmap "
          "image_undistorter`");
  parameters_ = &parameters;
  const auto count = static_cast<int64_t>(scene.cameras.size());
  parameters[prefix + kFocals] = parameter(std::vector<float>(scene.cameras.size(), 0.f), {count, 1});
}

void FocalRefinement::add_group(ParameterGroups& groups) const {
  if (!on()) return;
  ParameterGroup group{prefix_ + kFocalGroup, settings_.rate, {kFocalFinalRate, 0, 0, kFocalWarmUp}};
  group.epsilon = 1e-15f;
  group.sparse = true;  // cameras that a step does not see stay as they are
  groups.push_back(group);
}

const Tensor& FocalRefinement::log_focals() const { return parameters_->at(prefix_ + kFocals); }

Tensor FocalRefinement::narrowing() const { return on() ? exp(-log_focals()) : Tensor(); }

Tensor FocalRefinement::widening(int camera) const {
  if (!on()) return {};
  const Tensor own = exp(slice(log_focals(), 0, camera, int64_t{camera} + 1));
  return concat({own, own, ones({1, 1})}, 0);
}

std::vector<Figure> FocalRefinement::figures() const {
  if (!on()) return {};
  return {{"focal_percent", 0, mean(abs(exp(stop_gradient(log_focals())) - 1.f)) * 100.f}};
}

std::vector<double> FocalRefinement::factors() const {
  if (!on()) return {};
  std::vector<double> out;
  for (const float log_focal : log_focals().to_host()) out.push_back(std::exp(double{log_focal}));
  return out;
}

}  // namespace cloam
