// Poses and focal lengths of a log's photos that street-gaussians learns: what is drawn, against photos given from
// there; that disturbed poses come back.
#include <doctest/doctest.h>

#include <Eigen/Geometry>
#include <cmath>

#include "models/scene/pose.h"
#include "models/train/grows.h"
#include "models/train/refines_cameras.h"
#include "tests/models/folder.h"
#include "tests/models/learned_cameras.h"
#include "tests/models/toy_street.h"

using namespace cloam;
using Eigen::Vector3d;

namespace {

/// Photos of two actors, by gaussians and a sky that stand still and are sharp enough to tell where a camera is.
struct StandingStreet {
  Folder folder;
  Scene truth = toy_street(folder.path, {.frames = 4, .width = 64, .height = 48});
  Settings settings = small_settings("street-gaussians");
  std::unique_ptr<Method> model;

  StandingStreet() {
    truth.actors = {toy_actor("a", {2, 4, 1.5}, 12, 2), toy_actor("b", {2, 4, 1.5}, 12, -2)};
    settings.insert(settings.end(), {{"poses.refine", "true"},
                                     {"poses.rate", "2e-3"},
                                     {"poses.warm_up", "0"},
                                     {"intrinsics.refine", "true"},
                                     {"intrinsics.centres", "true"},
                                     {"intrinsics.rate", "5e-3"},
                                     {"growth.start", "100000"},
                                     {"exposure", "false"},
                                     {"weight.lidar", "0"},
                                     {"weight.sky", "0"},
                                     {"weight.actors", "0"},
                                     {"initial.lidar", "300"},
                                     {"initial.fewest", "150"}});
    model = built_of(truth, toy_pixels(truth));
    for (const auto& [name, p] : model->parameters()) {
      if (!name.ends_with(".opacities") && !name.ends_with(".sh_first") && name != "sky") continue;
      std::vector<float> values(static_cast<size_t>(p.numel()), 4.f);
      for (size_t i = 0; i < values.size() && !name.ends_with(".opacities"); ++i)
        values[i] = (name == "sky" ? 0.5f : 0.f) + 0.5f * std::sin(2.3f * static_cast<float>(i));
      put(*model, name, values);
    }
  }
  /// With another scene's photos, and what stands still.
  std::unique_ptr<Method> built_of(const Scene& scene, const Pixels& photos) const {
    auto method = configured("street-gaussians", settings);
    method->build({scene}, 3);
    load_data(*method, scene, photos);
    if (!model) return method;
    // Where gaussians begin follows the poses: as a resumed run, it has those of the model.
    TensorMap shapes;
    for (const auto& [name, values] : model->parameters())
      shapes[name].shape.assign(values.shape().begin(), values.shape().end());
    as<Grows>(*method)->fit_to(shapes);
    method->restore(model->state());
    for (const auto& [name, values] : model->parameters()) put(*method, name, values.to_host());
    return method;
  }
};

double loss_of(Method& method) { return double{method.step({1, 10, 7, {}}, {}).loss.item()}; }

}  // namespace

TEST_CASE("street-gaussians: a photo from where its camera was learned to be is one that was given from there") {
  const StandingStreet street;
  const Vector3d axis = Vector3d(2, -1, 2) / 3, shift(0.3, -0.2, 0.4);  // metres
  const double angle = 0.03, factor = 1.04;
  Scene there = street.truth;
  for (Frame& frame : there.frames)
    frame.world_from_camera =
        frame.world_from_camera * pose_from(Eigen::Matrix3d(Eigen::AngleAxisd(angle, axis)), shift);
  const LensChange lens{factor, {-0.02, 0.03}};
  there.cameras[0] = with_lens(there.cameras[0], lens);
  const auto given = street.built_of(there, toy_pixels(there)),
             learned = street.built_of(street.truth, toy_pixels(street.truth));
  const Shape count = street.model->parameters().at("background.opacities").shape();
  for (Method* method : {given.get(), learned.get()})  // so that the sky is seen through them
    put(*method, "background.opacities", std::vector<float>(static_cast<size_t>(count[0]), -2.f));
  const double before = loss_of(*learned);
  // Shifts are in units of 5 m and bring turns along that keep in place what is 15 m away.
  const Vector3d turn = 2 * std::tan(angle / 2) * axis - Vector3d(shift.y(), -shift.x(), 0) / 15;
  std::vector<float> turns, shifts;
  for (size_t i = 0; i < 3 * street.truth.frames.size(); ++i) {
    turns.push_back(static_cast<float>(turn[static_cast<Eigen::Index>(i % 3)]));
    shifts.push_back(static_cast<float>(shift[static_cast<Eigen::Index>(i % 3)] / 5));
  }
  put(*learned, "poses.turns", turns);
  put(*learned, "poses.shifts", shifts);
  put(*learned, "intrinsics.log_focals", {static_cast<float>(std::log(factor))});
  put(*learned, "intrinsics.centres", {static_cast<float>(lens.centre.x()), static_cast<float>(lens.centre.y())});
  const double want = loss_of(*given), found = loss_of(*learned);
  CHECK(found == doctest::Approx(want).epsilon(1e-4));
  CHECK(std::abs(before - want) > 0.01 * want);
}

TEST_CASE("street-gaussians: turns of photos come to where they show the gaussians") {
  StandingStreet street;
  Scene wrong = street.truth;
  for (size_t i = 0; i < wrong.frames.size(); ++i) {
    const Vector3d axis = Vector3d(std::cos(2. * static_cast<double>(i)), std::sin(2. * static_cast<double>(i)), 0.5);
    Eigen::Matrix4d& pose = wrong.frames[i].world_from_camera;
    pose = pose * pose_from(Eigen::Matrix3d(Eigen::AngleAxisd(0.0175, axis.normalized())), {0, 0, 0});
  }
  const auto method = street.built_of(wrong, painted(toy_pixels(street.truth), *street.model, street.truth));
  learn_alone(*method, "poses.", *street.model, 400);
  const std::vector<Eigen::Matrix4d> poses = as<RefinesCameras>(*method)->refined_poses(0);
  double left = 0;
  for (size_t i = 0; i < poses.size(); ++i)
    left += Eigen::AngleAxisd(
                Eigen::Matrix3d((street.truth.frames[i].world_from_camera.inverse() * poses[i]).topLeftCorner<3, 3>()))
                .angle() /
            static_cast<double>(poses.size());
  MESSAGE("0.0175 radians before, ", left, " after");
  CHECK(left < 0.4 * 0.0175);
}
