// See street_gaussians_model.h.
#include "models/methods/street_gaussians_model.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "models/gaussians/values.h"
#include "models/io/tensors.h"
#include "models/scene/pose.h"
#include "models/splat/parameters.h"
#include "models/splat/sky_map.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr double kMiddle = 0.5;  // of an actor's time: how it looks alone
constexpr int64_t kExposureNumbers = 6;
constexpr double kOutOfSight = 1e4;  // metres behind a camera

/// Of the way from its first box to its last, in time.
double share_of(const Actor& actor, double time) {
  const double first = actor.boxes.front().timestamp, last = actor.boxes.back().timestamp;
  return last > first ? std::clamp((time - first) / (last - first), 0.0, 1.0) : 0;
}

Shape waves_shape(int64_t count, int waves) { return {count, waves - 1, 3}; }

}  // namespace

StreetGaussiansModel::StreetGaussiansModel(const StreetGaussiansConfig& config, Params& parameters, const Scene& scene)
    : config_(config), params_(parameters), actors_(scene.actors) {
  std::vector<double> radii;
  for (const Actor& actor : actors_)
    if (!actor.boxes.empty()) radii.push_back(actor.size.norm() / 2);
  std::sort(radii.begin(), radii.end());
  if (!radii.empty()) actor_radius_ = std::max(0.1, radii[radii.size() / 2]);
  for (const Frame& frame : scene.frames) sensors_.push_back(frame.sensor);
  std::sort(sensors_.begin(), sensors_.end());
  sensors_.erase(std::unique(sensors_.begin(), sensors_.end()), sensors_.end());
  const auto zeros_for = [&](const char* name, int64_t rows, int64_t columns) {
    params_[name] = parameter(std::vector<float>(static_cast<size_t>(rows * columns)), {rows, columns});
  };
  if (config.exposure) zeros_for(kExposureName, static_cast<int64_t>(sensors_.size()), kExposureNumbers);
  boxes_.build(config.boxes, scene, parameters);
  const int64_t side = config.sky_side;
  params_[kSkyName] =
      parameter(std::vector<float>(static_cast<size_t>(18 * side * side), kFirstSky), {6, side, side, 3});
}

void StreetGaussiansModel::put(const StreetStart& start) {
  put_gaussians(params_, start.background, kBackgroundPart);
  std::erase_if(params_, [](const auto& one) { return one.first.starts_with(kActorsPart); });
  if (start.owners.empty()) return set_owners({});
  put_gaussians(params_, start.actors, kActorsPart);
  const auto count = static_cast<int64_t>(start.owners.size());
  if (config_.waves > 1)
    params_[kWavesName] = parameter(std::vector<float>(static_cast<size_t>(3 * count * (config_.waves - 1))),
                                    waves_shape(count, config_.waves));
  set_owners(start.owners);
}

void StreetGaussiansModel::put_ground(const Gaussians& ground) {
  ground_.clear();
  if (ground.count() > 0) put_gaussians(ground_, ground);
}

void StreetGaussiansModel::fit_to(const TensorMap& parameters) {
  const auto count_in = [&](const char* part) -> int64_t {
    const auto found = parameters.find(std::string(part) + "opacities");
    return found == parameters.end() || found->second.shape.size() != 1 ? 0 : found->second.shape[0];
  };
  if (count_in(kBackgroundPart) > 0) put_zeros(params_, count_in(kBackgroundPart), kBackgroundPart);
  const int64_t count = count_in(kActorsPart);
  std::erase_if(params_, [](const auto& one) { return one.first.starts_with(kActorsPart); });
  if (count > 0) put_zeros(params_, count, kActorsPart);
  if (count > 0 && config_.waves > 1)
    params_[kWavesName] = parameter(std::vector<float>(static_cast<size_t>(3 * count * (config_.waves - 1))),
                                    waves_shape(count, config_.waves));
  set_owners(std::vector<int32_t>(static_cast<size_t>(count), 0));
  boxes_.fit_to(parameters);
}

Tensor StreetGaussiansModel::exposed(const Tensor& planes, const std::string& sensor) const {
  const auto found = std::find(sensors_.begin(), sensors_.end(), sensor);
  if (!config_.exposure || found == sensors_.end()) return planes;
  const Tensor& all = params_.at(kExposureName);
  std::vector<float> shares(sensors_.size(), -1 / static_cast<float>(sensors_.size()));  // its own less the mean
  shares[static_cast<size_t>(found - sensors_.begin())] += 1;
  const Tensor weights = from_host(shares, {all.dim(0), 1});
  const auto own = [&](int64_t first) {
    return reshape(sum(slice(all, 1, first, first + 3) * weights, {{0}}), {3, 1, 1});
  };
  return planes * exp(own(0)) + own(3);
}

std::array<float, 6> StreetGaussiansModel::exposure_of(const std::string& sensor) const {
  const std::vector<float> none = exposed(zeros({3, 1, 1}), sensor).to_host(),
                           one = exposed(ones({3, 1, 1}), sensor).to_host();
  return {one[0] - none[0], one[1] - none[1], one[2] - none[2], none[0], none[1], none[2]};
}

StreetGaussiansModel::Standing StreetGaussiansModel::standing(std::size_t actor, const Eigen::Matrix4d& world_from_box,
                                                              double time) const {
  const Actor& who = actors_[actor];
  return {who.asset ? place_of(*who.asset) : actor, world_from_box, share_of(who, time),
          boxes_.parts_at(actor, who, time)};
}

void StreetGaussiansModel::set_owners(std::vector<int32_t> owners) {
  owners_ = std::move(owners);
  owner_rows_ = half_sizes_ = Tensor();
  if (owners_.empty()) return;
  const auto count = static_cast<int64_t>(owners_.size());
  owner_rows_ = from_host(owners_, {count});
  std::vector<float> halves;
  for (const int32_t owner : owners_)
    for (int k = 0; k < 3; ++k) halves.push_back(static_cast<float>(actors_[static_cast<size_t>(owner)].size[k] / 2));
  half_sizes_ = from_host(halves, {count, 3});
}

void StreetGaussiansModel::adopt(std::size_t actor, const Gaussians& looks) {
  Gaussians all = has_actors() ? gaussians_in(params_, {}, kActorsPart) : Gaussians();
  append(all, looks);
  put_gaussians(params_, all, kActorsPart);
  const auto count = static_cast<int64_t>(all.count());
  if (config_.waves > 1) {
    const Shape shape = waves_shape(count, config_.waves);
    std::vector<float> waves = params_.contains(kWavesName) ? params_.at(kWavesName).to_host() : std::vector<float>();
    waves.resize(static_cast<size_t>(numel(shape)));
    params_[kWavesName] = parameter(waves, shape);
  }
  std::vector<int32_t> owners = owners_;
  owners.resize(all.count(), static_cast<int32_t>(actor));
  set_owners(std::move(owners));
}

int64_t StreetGaussiansModel::count(const char* part) const {
  const auto found = params_.find(std::string(part) + "opacities");
  return found == params_.end() ? 0 : found->second.dim(0);
}

Tensor StreetGaussiansModel::of_actors() const {
  const Tensor background = zeros({count(kBackgroundPart), 1});
  return has_actors() ? concat({background, ones({count(kActorsPart), 1})}, 0) : background;
}

Tensor StreetGaussiansModel::mean_of_actor(const Tensor& rows) const {
  const auto all = static_cast<int64_t>(actors_.size());
  const Tensor counts = scatter_add_rows(ones({rows.dim(0), 1}), owner_rows_, all);
  return gather_rows(scatter_add_rows(rows, owner_rows_, all) / maximum(counts, 1.f), owner_rows_);
}

/// Poses, what was learned of the boxes before and after, and cosines of the way in time (Yan et al. 2024, eq. 5).
Placements StreetGaussiansModel::placements(const std::vector<Standing>& standing) const {
  std::vector<float> poses, shares, sides, heights;
  std::vector<int32_t> rows;
  for (const auto& [actor, pose, share, corrections, mirrored] : standing) {
    sides.push_back(mirrored ? -1.f : 1.f);
    for (int i = 0; i < 12; ++i) poses.push_back(static_cast<float>(pose(i / 4, i % 4)));
    for (const auto& [row, part] : corrections) {
      rows.push_back(row);
      shares.push_back(part);
    }
    for (int wave = 1; wave < config_.waves; ++wave)
      heights.push_back(static_cast<float>(std::cos(wave * std::numbers::pi * share)));
  }
  const auto count = static_cast<int64_t>(standing.size());
  return {{from_host(poses, {count, 3, 4}), boxes_.shifts(), boxes_.turns(), from_host(rows, {count, 2}),
           from_host(shares, {count, 2}), from_host(sides, {count})},
          config_.waves > 1 ? from_host(heights, {count, config_.waves - 1}) : Tensor()};
}

ThingsModel StreetGaussiansModel::things(int degree) const {
  return {splat_model(params_, degree, kActorsPart), config_.waves > 1 ? params_.at(kWavesName) : Tensor(),
          owner_rows_};
}

/// Actors who are not there stand behind the camera, where no gaussian is seen.
Projection StreetGaussiansModel::projection(const View& view, const ViewMove& move, int degree,
                                            const std::vector<bool>& mirrored) const {
  DrawOptions how = options();
  how.move = move;
  const Tensor camera = view_matrix(view.world_from_camera);
  const Projection background = projection_of(splat_model(params_, degree, kBackgroundPart), view.camera, camera, how);
  if (!has_actors()) return background;
  const Eigen::Matrix4d nowhere = view.world_from_camera * pose_from(Eigen::Matrix3d::Identity(), {0, 0, -kOutOfSight});
  std::vector<Standing> standing;
  for (size_t a = 0; a < actors_.size(); ++a) {
    const auto pose = world_from_box_at(actors_[a], view.time);
    if (pose) {
      standing.push_back(this->standing(a, *pose, view.time));
      standing.back().actor = a;
      standing.back().mirrored = !mirrored.empty() && mirrored[a];
    } else {
      standing.push_back({a, nowhere, 0, {}});
    }
  }
  return together(background, projection_of(things(degree), placements(standing), view.camera, camera, how));
}

ThingsModel StreetGaussiansModel::things_of(const std::vector<Standing>& standing) const {
  if (!has_actors()) return {};
  std::vector<int32_t> rows, owners;
  for (size_t s = 0; s < standing.size(); ++s)
    for (size_t row = 0; row < owners_.size(); ++row)
      if (static_cast<size_t>(owners_[row]) == standing[s].actor) {
        rows.push_back(static_cast<int32_t>(row));
        owners.push_back(static_cast<int32_t>(s));
      }
  ThingsModel all = things(config_.harmonics.degree);
  const auto count = static_cast<int64_t>(rows.size());
  if (count == 0) return {};
  const Tensor which = from_host(rows, {count});
  Cloud& cloud = all.model.cloud;
  for (Tensor* part : {&cloud.means, &cloud.scales, &cloud.rotations, &cloud.opacities, &all.model.harmonics.first,
                       &all.model.harmonics.rest, &all.waves})
    if (*part) *part = gather_rows(*part, which);
  all.owners = from_host(owners, {count});
  return all;
}

StreetGaussiansModel::Shown StreetGaussiansModel::shown(const View& view) const {
  const Tensor camera = view_matrix(view.world_from_camera);
  Shown out;
  out.projection =
      projection_of(splat_model(params_, config_.harmonics.degree, kBackgroundPart), view.camera, camera, options());
  if (!ground_.empty()) out.ground = projection_of(splat_model(ground_, 0), view.camera, camera, options());
  out.actors.assign(static_cast<size_t>(count(kBackgroundPart)), 0);
  std::vector<Standing> standing;
  std::vector<int> numbers;
  for (size_t a = 0; a < actors_.size(); ++a)
    if (const auto pose = world_from_box_at(actors_[a], view.time)) {
      standing.push_back(this->standing(a, *pose, view.time));
      numbers.push_back(static_cast<int>(a) + 1);
    }
  const ThingsModel things = things_of(standing);
  if (!things.owners) return out;
  out.projection =
      together(out.projection, projection_of(things, placements(standing), view.camera, camera, options()));
  for (const int32_t owner : things.owners.to_host<int32_t>())
    out.actors.push_back(numbers[static_cast<size_t>(owner)]);
  return out;
}

StreetGaussiansModel::Shown StreetGaussiansModel::alone(std::size_t actor, const Camera& camera,
                                                        const Eigen::Matrix4d& box_from_camera) const {
  const std::vector<Standing> standing = {{actor, Eigen::Matrix4d::Identity(), kMiddle, {}}};
  const ThingsModel things = things_of(standing);
  if (!things.owners) return {};
  return {projection_of(things, placements(standing), camera, view_matrix(box_from_camera), options()),
          std::vector<int>(static_cast<size_t>(things.owners.dim(0)), static_cast<int>(actor) + 1)};
}

Gaussians StreetGaussiansModel::gaussians_of(std::size_t actor, const Gaussians& like) const {
  Gaussians out = like;
  if (!has_actors()) return out;
  const Gaussians all = gaussians_in(params_, like, kActorsPart);
  const std::vector<float> waves = config_.waves > 1 ? params_.at(kWavesName).to_host() : std::vector<float>();
  const auto count = static_cast<size_t>(config_.waves - 1);
  for (size_t row = 0; row < owners_.size(); ++row) {
    if (static_cast<size_t>(owners_[row]) != actor) continue;
    for (const auto& [name, values, width] : kGaussianArrays) {
      const auto begin = (all.*values).begin() + static_cast<std::ptrdiff_t>(row * width);
      (out.*values).insert((out.*values).end(), begin, begin + static_cast<std::ptrdiff_t>(width));
    }
    for (size_t wave = 0; wave < count; ++wave)
      for (size_t c = 0; c < 3; ++c)
        out.sh_first[out.sh_first.size() - 3 + c] +=
            waves[3 * (row * count + wave) + c] *
            static_cast<float>(std::cos(static_cast<double>(wave + 1) * std::numbers::pi * kMiddle));
  }
  return out;
}

std::size_t StreetGaussiansModel::place_of(const AssetName& asset) const {
  for (size_t i = 0; i < actors_.size() && asset.scene == 0; ++i)
    if (actors_[i].id == asset.actor_id) return i;
  throw Error(Fault::data, text("there is no actor ", asset.actor_id, " in log ", asset.scene, " of this run"));
}

}  // namespace cloam
