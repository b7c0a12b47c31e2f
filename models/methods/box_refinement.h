// Boxes of actors as parameters (Yan et al. 2024, "Street Gaussians", section 3; the actors' trajectories of NeuRAD,
// Tonderski et al. 2024): the box of each step has a shift in its own axes and a turn about its z axis, which begin as
// nothing and are learned with the street. Between two boxes both are linear in time, and so they are from one step
// that trains to the next: of a step that was held out nothing shows where its boxes belong.
#pragma once
#include <array>
#include <map>
#include <set>

#include "models/io/safetensors.h"
#include "models/nn/params.h"
#include "models/scene/scene.h"
#include "models/street/street_boxes.h"
#include "models/train/config.h"
#include "models/train/method.h"

namespace cloam {

struct BoxSettings {
  bool refine = false;
  float smooth = 0;                                 // weight
  float rate_positions = 5e-4f, rate_yaws = 1e-5f;  // metres, radians
};
/// Declares the settings.
void bind_boxes(Config& config, BoxSettings& settings);

constexpr char kPositionsName[] = "poses.positions", kYawsName[] = "poses.yaws";

/// Of N boxes in a row of three of one actor each: accelerations are linear in the boxes' shifts.
struct BoxMotion {
  Tensor rows;      // int32 [N*6] of corrections: two of the box before, of the box and of the one after
  Tensor by_shift;  // [N*6,3,3]: (m/s^2) / m, of a shift in the box's axes
  Tensor given;     // [N,3], of the boxes as given
};

/// Actors are named by their places in a log; a box by its actor and step, so that what was learned of it goes with it
/// where the actor is edited.
class BoxRefinement {
 public:
  /// Of the boxes of the scene's actors; does nothing where boxes shall stay. The parameters outlive this; their names
  /// and those of the state begin with `prefix`.
  void build(const BoxSettings& settings, const Scene& scene, Params& parameters, const std::string& prefix = "");
  bool on() const { return parameters_ && parameters_->contains(prefix_ + kPositionsName); }
  /// sparse: steps that see another log leave these boxes where they are.
  void add_groups(ParameterGroups& groups, bool sparse = false) const;
  /// Before a checkpoint's parameters are put in: as many rows as it has, of which restore() tells whose they are.
  void fit_to(const TensorMap& parameters);
  void add_state(TensorMap& state) const;
  void restore(const TensorMap& state);

  /// A row of the parameters, and the share that it has in a box between two others.
  struct Part {
    int32_t row = 0;
    float share = 0;
  };
  /// Of the boxes before and after that time, of those whose steps train; before the first and after the last it has
  /// what was learned of that one. Nothing of an actor of whom nothing was learned.
  std::array<Part, 2> parts_at(std::size_t place, const Actor& actor, double time) const;
  /// shifts [B,3], turns [B,1]: of no box where boxes stay.
  Tensor shifts() const;
  Tensor turns() const;
  /// The boxes of moments (boxes_of) where they were learned to be: differentiable in what was learned. times: of the
  /// moments, seconds.
  StreetBoxes moved(const StreetBoxes& boxes, const std::vector<Actor>& actors, const std::vector<double>& times) const;
  /// The actors with their boxes as they were learned; empty where boxes stay.
  std::vector<Actor> refined(const std::vector<Actor>& actors) const;
  /// Mean square of the accelerations of boxes as they are learned, m^2/s^4, of boxes with one before and one behind
  /// them in the log; an empty handle where there are none or boxes stay.
  Tensor square_accelerations() const;
  /// The same, weighed; an empty handle where it has no weight.
  Tensor smoothness() const;
  /// `loss` and that.
  Tensor with_smoothness(const Tensor& loss) const;
  /// How far boxes are from where they were given, in the mean: metres.
  std::vector<Figure> figures() const;

 private:
  void put_zeros(int64_t rows);
  BoxMotion motion_of(const std::vector<Actor>& actors) const;

  BoxSettings settings_;
  Params* parameters_ = nullptr;
  std::string prefix_;
  std::map<std::pair<std::size_t, int>, int32_t> rows_;  // by actor and step
  std::set<int> steps_;                                  // that train
  BoxMotion motion_;
};

}  // namespace cloam
