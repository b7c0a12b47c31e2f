// See pose_refinement.h.
#include "models/methods/pose_refinement.h"

#include <Eigen/Geometry>
#include <numbers>

#include "models/render/scene_frame.h"
#include "models/splat/placed.h"
#include "runtime/ops.h"

namespace cloam {
namespace {

constexpr char kPoseTurns[] = "poses.turns", kPoseShifts[] = "poses.shifts", kPoseGroup[] = "poses.";
constexpr double kDegrees = 180 / std::numbers::pi;

/// [N,3,3]: the transposes of the rotations.
Tensor turned_back(const Tensor& turns) {
  const Tensor ones = full({turns.dim(0), 1}, 1.f), half = turns * 0.5f;
  return axes_of(concat({ones, half}, 1) / sqrt(1.f + sum(square(half), {{1}, true})));
}

Tensor mean_length(const Tensor& vectors) { return mean(sqrt(sum(square(vectors), {{1}}))); }

}  // namespace

void bind_poses(Config& c, PoseSettings& o) {
  c.bind("poses.refine", o.refine, "learn the poses of the training photos, which begin as given");
  c.bind("poses.rate", o.rate,
         "poses: learning rate of turns (radians) and shifts (parts of the distance to what is seen; streets: of 5 m)");
  c.bind("poses.final_rate", o.final_rate, "poses: learning rate at the last step, as a fraction of poses.rate");
  c.bind("poses.warm_up", o.warm_up, "poses: steps in which their learning rate grows to poses.rate", kStepsOrNone);
}

void PoseRefinement::build(const PoseSettings& settings, const Scene& scene, Params& parameters,
                           const std::string& prefix, const std::optional<PoseScale>& scale) {
  settings_ = settings;
  prefix_ = prefix;
  if (!settings_.refine) return;
  if (scale)
    scale_ = *scale;
  else
    scale_.unit = scale_.distance = viewing_distance(scene);
  parameters_ = &parameters;
  given_.clear();
  for (const std::size_t frame : frames_of(scene, Split::train))
    given_.push_back(scene.frames[frame].world_from_camera);
  const auto photos = static_cast<int64_t>(given_.size());
  for (const char* name : {kPoseTurns, kPoseShifts})
    parameters[prefix + name] = parameter(std::vector<float>(3 * given_.size(), 0.f), {photos, 3});
}

void PoseRefinement::add_group(ParameterGroups& groups) const {
  if (!on()) return;
  ParameterGroup group{prefix_ + kPoseGroup, settings_.rate, {settings_.final_rate, 0, 0, settings_.warm_up}};
  group.epsilon = 1e-15f;
  group.sparse = true;  // a step of splat sees one photo: the others stay where they are
  groups.push_back(group);
}

const Tensor& PoseRefinement::shifts() const { return parameters_->at(prefix_ + kPoseShifts); }

/// [N,3], with those that shifts bring along.
Tensor PoseRefinement::turns() const {
  const Tensor along = concat({slice(shifts(), 1, 1, 2), -slice(shifts(), 1, 0, 1), zeros({shifts().dim(0), 1})}, 1);
  return parameters_->at(prefix_ + kPoseTurns) + along * static_cast<float>(scale_.unit / scale_.distance);
}

Tensor PoseRefinement::moved(const Tensor& poses, double scale) const {
  const int64_t photos = poses.dim(0);
  const Tensor axes = reshape(slice(poses, 1, 0, 9), {photos, 3, 3});
  const Tensor turned = matmul(axes, transpose(turned_back(turns())));
  const Tensor shift = shifts() * static_cast<float>(scale_.unit * scale);
  const Tensor shifted = slice(poses, 1, 9, 12) + sum(axes * unsqueeze(shift, 1), {{2}});
  return concat({reshape(turned, {photos, 9}), shifted}, 1);
}

ViewMove PoseRefinement::move_of(size_t photo) const {
  if (!on()) return {};
  const auto row = static_cast<int64_t>(photo);
  const auto own = [&](const Tensor& of_all) { return slice(of_all, 0, row, row + 1); };
  return {reshape(turned_back(own(turns())), {3, 3}), transpose(own(shifts())) * static_cast<float>(scale_.unit), {}};
}

std::vector<Figure> PoseRefinement::figures() const {
  if (!on()) return {};
  return {{"turned", 0, mean_length(stop_gradient(turns())) * static_cast<float>(kDegrees)},
          {"shifted", 0, mean_length(stop_gradient(shifts())) * static_cast<float>(scale_.unit)}};
}

std::vector<Eigen::Matrix4d> PoseRefinement::poses() const {
  if (!on()) return {};
  const std::vector<float> turned = turns().to_host(), away = shifts().to_host();
  std::vector<Eigen::Matrix4d> out = given_;
  for (size_t i = 0; i < out.size(); ++i) {
    const auto of = [&](const std::vector<float>& all) {
      return Eigen::Vector3d(all[3 * i], all[3 * i + 1], all[3 * i + 2]);
    };
    const Eigen::Vector3d half = of(turned) / 2;
    Eigen::Matrix4d moved = Eigen::Matrix4d::Identity();
    moved.topLeftCorner<3, 3>() = Eigen::Quaterniond(1, half.x(), half.y(), half.z()).normalized().toRotationMatrix();
    moved.topRightCorner<3, 1>() = of(away) * scale_.unit;
    out[i] = given_[i] * moved;
  }
  return out;
}

}  // namespace cloam
