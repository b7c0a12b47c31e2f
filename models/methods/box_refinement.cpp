// See box_refinement.h.
#include "models/methods/box_refinement.h"

#include <algorithm>
#include <cstddef>

#include "models/io/tensors.h"
#include "models/scene/pose.h"
#include "runtime/ops.h"

namespace cloam {
namespace {

constexpr float kFinalPositions = 0.2f, kFinalYaws = 0.5f;  // of the rates, at the last step
constexpr char kBoxesState[] = "boxes";

/// Three boxes in a row, at times t0 < t1 < t2, move by the second difference quotient of their places: the change of
/// velocity from the first to the second half, over the time between the halves' middles.
std::array<double, 3> acceleration_weights(double t0, double t1, double t2) {
  const double before = t1 - t0, after = t2 - t1, between = (before + after) / 2;
  return {1 / (before * between), -(1 / before + 1 / after) / between, 1 / (after * between)};
}

/// Steps of which a photo or a sweep trains.
std::set<int> steps_that_train(const Scene& scene) {
  std::set<int> steps;
  for (const Frame& frame : scene.frames)
    if (frame.split == Split::train) steps.insert(frame.step);
  for (const Sweep& sweep : scene.sweeps)
    if (sweep.split == Split::train) steps.insert(sweep.step);
  return steps;
}

}  // namespace

void bind_boxes(Config& c, BoxSettings& o) {
  c.bind("actors.refine", o.refine, "learn a shift and a turn of each of the actors' boxes");
  c.bind("weight.smooth", o.smooth, "actors.refine: weight of the square of the boxes' accelerations, in m/s^2");
  c.bind("train.rate_positions", o.rate_positions,
         "learning rate of the boxes' shifts, in metres; it falls to a fifth");
  c.bind("train.rate_yaws", o.rate_yaws, "learning rate of the boxes' turns, in radians; it falls to a half");
}

void BoxRefinement::build(const BoxSettings& settings, const Scene& scene, Params& parameters,
                          const std::string& prefix) {
  const std::vector<Actor>& actors = scene.actors;
  settings_ = settings;
  steps_ = steps_that_train(scene);
  prefix_ = prefix;
  parameters_ = &parameters;
  rows_.clear();
  if (!settings.refine) return;
  for (size_t a = 0; a < actors.size(); ++a)
    for (const ActorBox& box : actors[a].boxes)
      rows_.emplace(std::pair(a, box.step), static_cast<int32_t>(rows_.size()));
  if (rows_.empty()) return;
  put_zeros(static_cast<int64_t>(rows_.size()));
  motion_ = motion_of(actors);
}

BoxMotion BoxRefinement::motion_of(const std::vector<Actor>& actors) const {
  std::vector<int32_t> rows;
  std::vector<float> by_shift, given;
  for (size_t a = 0; a < actors.size(); ++a) {
    const std::vector<ActorBox>& boxes = actors[a].boxes;
    for (size_t b = 1; b + 1 < boxes.size(); ++b) {
      const ActorBox &before = boxes[b - 1], &box = boxes[b], &after = boxes[b + 1];
      const bool in_a_row = after.step == box.step + 1 && box.step == before.step + 1;
      if (!in_a_row || !(before.timestamp < box.timestamp && box.timestamp < after.timestamp)) continue;
      const auto weights = acceleration_weights(before.timestamp, box.timestamp, after.timestamp);
      Eigen::Vector3d acceleration = Eigen::Vector3d::Zero();
      for (size_t k = 0; k < 3; ++k) {
        const ActorBox& one = boxes[b - 1 + k];
        const Eigen::Matrix4d& pose = one.world_from_box;
        acceleration += weights[k] * (pose - box.world_from_box).topRightCorner<3, 1>();
        for (const auto& [row, share] : parts_at(a, actors[a], one.timestamp)) {
          rows.push_back(row);
          for (int i = 0; i < 9; ++i)
            by_shift.push_back(static_cast<float>(double{share} * weights[k] * pose(i / 3, i % 3)));
        }
      }
      for (int i = 0; i < 3; ++i) given.push_back(static_cast<float>(acceleration[i]));
    }
  }
  if (given.empty()) return {};
  const auto count = static_cast<int64_t>(given.size() / 3);
  return {from_host(rows, {6 * count}), from_host(by_shift, {6 * count, 3, 3}), from_host(given, {count, 3})};
}

void BoxRefinement::add_groups(ParameterGroups& groups, bool sparse) const {
  if (!on()) return;
  const auto add = [&](const char* name, float rate, float final_rate) {
    ParameterGroup group{prefix_ + name, rate, {final_rate}};
    group.epsilon = 1e-15f;
    group.sparse = sparse;
    groups.push_back(group);
  };
  add(kPositionsName, settings_.rate_positions, kFinalPositions);
  add(kYawsName, settings_.rate_yaws, kFinalYaws);
}

void BoxRefinement::put_zeros(int64_t rows) {
  for (const auto& [name, columns] : {std::pair(kPositionsName, int64_t{3}), {kYawsName, 1}})
    (*parameters_)[prefix_ + name] =
        parameter(std::vector<float>(static_cast<size_t>(rows * columns)), {rows, columns});
}

void BoxRefinement::fit_to(const TensorMap& parameters) {
  const auto found = parameters.find(prefix_ + kPositionsName);
  if (settings_.refine && found != parameters.end() && found->second.shape.size() == 2)
    put_zeros(found->second.shape[0]);
}

void BoxRefinement::add_state(TensorMap& state) const {
  if (!on()) return;
  std::vector<int64_t> boxes(2 * rows_.size());
  for (const auto& [box, row] : rows_) {
    boxes[2 * static_cast<size_t>(row)] = static_cast<int64_t>(box.first);
    boxes[2 * static_cast<size_t>(row) + 1] = box.second;
  }
  state[prefix_ + kBoxesState] = named_integers(boxes);
}

void BoxRefinement::restore(const TensorMap& state) {
  if (!on()) return;
  const std::vector<int64_t> boxes =
      integers_from(state, prefix_ + kBoxesState, static_cast<size_t>(2 * shifts().dim(0)));
  rows_.clear();
  for (size_t i = 0; i < boxes.size(); i += 2)
    rows_[{static_cast<size_t>(boxes[i]), static_cast<int>(boxes[i + 1])}] = static_cast<int32_t>(i / 2);
}

Tensor BoxRefinement::shifts() const { return on() ? parameters_->at(prefix_ + kPositionsName) : zeros({1, 3}); }

Tensor BoxRefinement::turns() const { return on() ? parameters_->at(prefix_ + kYawsName) : zeros({1, 1}); }

std::array<BoxRefinement::Part, 2> BoxRefinement::parts_at(std::size_t place, const Actor& actor, double time) const {
  const auto begin = actor.boxes.begin(), end = actor.boxes.end();
  const auto learned = [&](const ActorBox& box) {
    return rows_.contains({place, box.step}) && (steps_.empty() || steps_.contains(box.step));
  };
  const auto middle =
      std::lower_bound(begin, end, time, [](const ActorBox& box, double t) { return box.timestamp < t; });
  const auto next = std::find_if(middle, end, learned);
  const auto last = std::find_if(std::make_reverse_iterator(middle), std::make_reverse_iterator(begin), learned);
  const bool is_first = last == std::make_reverse_iterator(begin), is_last = next == end;
  if (actor.follows_path || (is_first && is_last)) return {};
  const ActorBox &before = is_first ? *next : *last, &after = is_last ? *last : *next;
  const double between =
      after.timestamp > before.timestamp ? (time - before.timestamp) / (after.timestamp - before.timestamp) : 0;
  return {Part{rows_.at({place, before.step}), static_cast<float>(1 - between)},
          Part{rows_.at({place, after.step}), static_cast<float>(between)}};
}

StreetBoxes BoxRefinement::moved(const StreetBoxes& given, const std::vector<Actor>& actors,
                                 const std::vector<double>& times) const {
  constexpr int64_t kOwner = offsetof(StreetBox, owner) / sizeof(float);
  constexpr int64_t kCentre = offsetof(StreetBox, centre) / sizeof(float);
  if (!on()) return given;
  const std::vector<int32_t> first = given.first.to_host<int32_t>();
  if (first.back() == 0) return given;
  const int64_t count = first.back();
  const std::vector<float> owners = slice(given.boxes, 1, kOwner, kOwner + 1).to_host();
  std::vector<int32_t> rows;
  std::vector<float> shares;
  for (std::size_t moment = 0; moment < times.size(); ++moment)
    for (int32_t box = first[moment]; box < first[moment + 1]; ++box) {
      const auto owner = static_cast<std::size_t>(owners[static_cast<std::size_t>(box)]);
      for (const auto& [row, share] : parts_at(owner, actors[owner], times[moment])) {
        rows.push_back(row);
        shares.push_back(share);
      }
    }
  const Tensor which = from_host(rows, {2 * count}), weights = from_host(shares, {count, 2, 1});
  const auto at_moment = [&](const Tensor& of_boxes) {
    return sum(reshape(gather_rows(of_boxes, which), {count, 2, of_boxes.dim(1)}) * weights, {{1}});
  };
  const auto numbers = [&](int64_t begin, int64_t end) { return slice(given.boxes, 1, begin, end); };
  const Tensor x = numbers(0, 3), y = numbers(3, 6), turn = at_moment(turns()), c = cos(turn), s = sin(turn);
  const Tensor axes = reshape(numbers(0, 9), {count, 3, 3});
  const Tensor centre = numbers(kCentre, kCentre + 3) + sum(axes * unsqueeze(at_moment(shifts()), 2), {{1}});
  return {given.first,
          concat({c * x + s * y, c * y - s * x, numbers(6, 9), centre, numbers(kCentre + 3, given.boxes.dim(1))}, 1)};
}

std::vector<Actor> BoxRefinement::refined(const std::vector<Actor>& actors) const {
  if (!on()) return {};
  const std::vector<float> by = shifts().to_host(), yaws = turns().to_host();
  std::vector<Actor> out = actors;
  for (size_t a = 0; a < out.size(); ++a) {
    if (out[a].follows_path) continue;
    for (ActorBox& box : out[a].boxes) {
      Eigen::Vector4f mixed = Eigen::Vector4f::Zero();  // shift, turn
      for (const auto& [part, share] : parts_at(a, actors[a], box.timestamp)) {
        const auto row = static_cast<size_t>(part);
        mixed += share * Eigen::Vector4f(by[3 * row], by[3 * row + 1], by[3 * row + 2], yaws[row]);
      }
      box.world_from_box *= pose_from(turn_about_z(mixed[3]), mixed.head<3>().cast<double>());
    }
  }
  return out;
}

Tensor BoxRefinement::square_accelerations() const {
  if (!motion_.rows) return {};
  const int64_t count = motion_.given.dim(0);
  const Tensor by = unsqueeze(gather_rows(shifts(), motion_.rows), 1);  // [N*6,1,3]
  const Tensor by_part = sum(motion_.by_shift * by, {{2}});             // [N*6,3]
  return mean(sum(square(motion_.given + sum(reshape(by_part, {count, 6, 3}), {{1}})), {{1}}));
}

Tensor BoxRefinement::smoothness() const {
  if (!(settings_.smooth > 0)) return {};
  const Tensor jerky = square_accelerations();
  return jerky ? settings_.smooth * jerky : jerky;
}

Tensor BoxRefinement::with_smoothness(const Tensor& loss) const {
  const Tensor jerky = smoothness();
  return jerky ? loss + jerky : loss;
}

std::vector<Figure> BoxRefinement::figures() const {
  if (!on()) return {};
  return {{"boxes_shifted", 0, mean(sqrt(sum(square(stop_gradient(shifts())), {{1}})))}};
}

}  // namespace cloam
