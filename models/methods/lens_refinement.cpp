// See lens_refinement.h.
#include "models/methods/lens_refinement.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include "runtime/error.h"
#include "runtime/ops.h"

namespace cloam {
namespace {

constexpr char kGroup[] = "intrinsics.", kFocals[] = "intrinsics.log_focals", kCentres[] = "intrinsics.centres";
// As those of poses: at first a scene says nothing about them.
constexpr float kLensFinalRate = 0.01f;
constexpr int kLensWarmUp = 200;  // steps

/// Why some lenses cannot be learned.
struct Refusal {
  const char *settings, *wanted, *found, *reason;
};

/// Fault::usage where `is_refused` holds of a camera of some photo.
void refuse(const Scene& scene, const Refusal& why, const std::function<bool(const Camera&)>& is_refused) {
  const auto first = std::ranges::find_if(
      scene.frames, [&](const Frame& f) { return is_refused(scene.cameras[static_cast<size_t>(f.camera)]); });
  if (first == scene.frames.end()) return;
  throw Error(Fault::usage, text("setting ", why.settings, ": looked for ", why.wanted, ", found ", why.found, " (",
                                 first->name, "; ", std::ranges::count_if(scene.cameras, is_refused), " of ",
                                 scene.cameras.size(), " cameras), ", why.reason, "\n  fix: leave ", why.settings,
                                 " out, or, of a capture, undistort the photos with `colmap image_undistorter`"));
}

void require_lenses(const LensSettings& settings, const Scene& scene) {
  refuse(scene,
         {"intrinsics.refine or intrinsics.centres", "pinholes and OpenCV lenses", "a fisheye or FOV lens",
          "which no method learns"},
         [](const Camera& c) { return c.model == CameraModel::fisheye || c.model == CameraModel::fov; });
  if (settings.centres)
    refuse(scene,
           {"intrinsics.centres", "pinholes", "a lens with distortion",
            "whose distortion would move with the principal point"},
           [](const Camera& c) { return c.model != CameraModel::pinhole; });
}

}  // namespace

void bind_lenses(Config& c, LensSettings& o) {
  c.bind("intrinsics.refine", o.refine, "learn the focal lengths of the cameras, which begin as given");
  c.bind("intrinsics.centres", o.centres, "learn the principal points of the cameras, which begin as given");
  c.bind("intrinsics.rate", o.rate,
         "intrinsics: learning rate of logarithms of focal lengths, and of principal points in focal lengths");
}

void LensRefinement::build(const LensSettings& settings, const Scene& scene, Params& parameters,
                           const std::string& prefix) {
  settings_ = settings;
  prefix_ = prefix;
  if (!settings.refine && !settings.centres) return;
  require_lenses(settings, scene);
  parameters_ = &parameters;
  const size_t count = scene.cameras.size();
  const auto nothing = [&](int64_t columns) {
    return parameter(std::vector<float>(count * static_cast<size_t>(columns), 0.f),
                     {static_cast<int64_t>(count), columns});
  };
  if (settings.refine) parameters[prefix + kFocals] = nothing(1);
  if (settings.centres) parameters[prefix + kCentres] = nothing(2);
}

void LensRefinement::add_group(ParameterGroups& groups) const {
  if (!on()) return;
  ParameterGroup group{prefix_ + kGroup, settings_.rate, {kLensFinalRate, 0, 0, kLensWarmUp}};
  group.epsilon = 1e-15f;
  group.sparse = true;  // cameras that a step does not see stay as they are
  groups.push_back(group);
}

LearnedLenses LensRefinement::lenses() const {
  LearnedLenses out;
  if (on() && settings_.refine) out.focals = exp(parameters_->at(prefix_ + kFocals));
  if (on() && settings_.centres) out.centres = parameters_->at(prefix_ + kCentres);
  return out;
}

LearnedLenses LensRefinement::lens(int camera) const {
  return on() ? lenses_of(lenses(), from_host(std::vector<int32_t>{camera}, {1})) : LearnedLenses();
}

std::vector<Figure> LensRefinement::figures() const {
  std::vector<Figure> out;
  const auto [focals, centres] = lenses();
  if (focals) out.push_back({"focal_percent", 0, mean(abs(stop_gradient(focals) - 1.f)) * 100.f});
  if (centres) out.push_back({"centre_percent", 0, mean(sqrt(sum(square(stop_gradient(centres)), {{1}}))) * 100.f});
  return out;
}

std::vector<LensChange> LensRefinement::changes() const {
  std::vector<LensChange> out;
  const auto [focals, centres] = lenses();
  if (focals)
    for (const float focal : focals.to_host()) out.push_back({focal});
  if (!centres) return out;
  const std::vector<float> at = centres.to_host();
  out.resize(at.size() / 2);
  for (size_t i = 0; i < out.size(); ++i) out[i].centre = {at[2 * i], at[2 * i + 1]};
  return out;
}

}  // namespace cloam
