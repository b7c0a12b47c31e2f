// What a method is to the trainer: settings, parameters, and a step. No method has its own loop. What a method may be
// besides is a capability with a header of its own, a second base class that commands ask for (capability.h).
#pragma once
#include <map>

#include "models/io/safetensors.h"
#include "models/nn/params.h"
#include "models/scene/scene.h"
#include "models/train/config.h"
#include "models/train/parameter_groups.h"

namespace cloam {

/// The photos that train, at the size they are used at.
struct PhotoSizes {
  uint64_t bytes = 0, largest = 0;  // of all, as 8-bit RGBA and masks; pixels of one
};

struct MemoryPlan {
  uint64_t parameters = 0, optimiser = 0, images = 0, work = 0;        // bytes
  std::string smaller = "smaller --set batch.* or field.* would fit";  // what the user can do about the model's part
  uint64_t total() const { return parameters + optimiser + images + work; }
};

/// Parameters and Adam's two moments of each, in float32.
MemoryPlan memory_of(const Params& parameters);

/// A named figure of a step for the progress line: a number, or a scalar that is evaluated together with the loss.
struct Figure {
  std::string name;
  double number = 0;
  Tensor pending = {};
  bool squared_error = false;  // pending is a mean squared error of colours; the figure is the PSNR, in dB
  double value() const;
};
Figure psnr_figure(const Tensor& mean_squared_error);

/// The loss of one step and its gradients, pending: the trainer evaluates all of it together. All of that is of the
/// share of the batch that was asked for (Progress::share), as if there were no other.
struct Step {
  Tensor loss;
  Tensors gradients;  // in the order asked for; an empty handle where the loss does not depend on one
  std::vector<Figure> figures = {};
  Tensors more = {};  // what after_step will read
  double weight = 0;  // of the share in the batch's mean; 0: as much as every other
  // What after_step and grow must know of the whole batch: they find the sums over all shares in their places. As many
  // of each kind in every share.
  Tensors sums = {};                 // f32
  std::vector<double*> counts = {};  // the method's own numbers
};
/// The gradients of a loss that is one graph.
Step step_of(const Tensor& loss, const Tensors& wanted);

class Method {
 public:
  virtual ~Method() = default;
  /// Declares every setting (before build).
  virtual void configure(Config& config) = 0;
  /// Fits the model to the scenes' extent and makes its parameters (seeded). Needs no pixels.
  virtual void build(const Scenes& scenes, uint64_t seed) = 0;
  /// What training will take. Asked before the data are loaded, later for the parameters alone (photos: none).
  virtual MemoryPlan memory(const PhotoSizes& photos) const = 0;
  virtual Params& parameters() = 0;
  virtual ParameterGroups groups() const = 0;
  /// One step's loss and its gradients by `wanted`, some of parameters().
  virtual Step step(const Progress& progress, const Tensors& wanted) = 0;
  /// Into how many shares its batch can be split so that each has something.
  virtual int64_t most_shares() const { return kMostShares; }
  /// After the optimiser's step: refresh an occupancy grid, update an EMA.
  virtual void after_step(const Progress&) {}
  /// What a resumed run needs beside parameters and optimiser; names without prefix.
  virtual TensorMap state() const { return {}; }
  virtual void restore(const TensorMap&) {}
};

}  // namespace cloam
