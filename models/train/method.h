// What a method is to the trainer: data, parameters, a loss, a picture. No method has its own loop.
#pragma once
#include <algorithm>
#include <memory>

#include "models/data/load_images.h"
#include "models/io/safetensors.h"
#include "models/nn/params.h"
#include "models/scene/scene.h"
#include "models/splat/gaussians.h"
#include "models/train/config.h"
#include "models/train/street.h"

namespace cloam {

/// Where training stands. horizon: the number of steps that schedules are stretched over (0 until it is chosen). A
/// training that was finished can go on beyond it, at their final values.
struct Progress {
  int64_t step = 0;  // 1 is the first
  int64_t horizon = 0;
  uint64_t seed = 0;
  /// 0 at the start, 1 from the horizon on; 0 as long as no horizon is chosen.
  float fraction() const {
    return horizon > 0 ? std::min(1.f, static_cast<float>(step) / static_cast<float>(horizon)) : 0.f;
  }
};

/// Learning rate of the parameters whose names begin with `prefix` (the longest prefix wins).
struct LearningRate {
  std::string prefix;
  float rate = 1e-3f;
  bool sparse = false;  // rows without a gradient stand still and count their own steps
  bool frozen = false;  // never changed: no gradient, no optimiser state
  float decay = 0;      // sparse ones: what is touched shrinks by rate * decay
};

struct AdamSettings {
  float beta1 = 0.9f, beta2 = 0.999f, epsilon = 1e-8f;
};

struct TrainingData {
  const Scene& scene;
  Pixels pixels;  // of the training split
};

/// The photos that train, at the size they are used at.
struct PhotoSizes {
  uint64_t bytes = 0, largest = 0;  // of all, as 8-bit RGBA and masks; pixels of one
};

struct MemoryPlan {
  uint64_t parameters = 0, optimiser = 0, images = 0, work = 0;       // bytes
  std::string smaller = "fewer of its --set batch.* or field.* fit";  // what the user can do about the model's part
  uint64_t total() const { return parameters + optimiser + images + work; }
};

/// of_parameters: in the order asked for, pending; an empty handle where the loss does not depend on one.
struct Gradients {
  Tensor loss;
  Tensors of_parameters;
};

/// Row i (of the first axis) of the parameter `name` was row source[i]; -1: it is new, and so is its optimiser state.
struct RowMove {
  std::string name;
  std::vector<int32_t> source;
};
using RowMoves = std::vector<RowMove>;

class AssetPrior;
struct CodeDenoiser;

class Method {
 public:
  virtual ~Method() = default;
  virtual const char* name() const = 0;
  /// Declares every setting (before build).
  virtual void configure(Config& config) = 0;
  /// Fits the model to the scenes' extent and makes its parameters (seeded). Needs no pixels.
  virtual void build(const Scenes& scenes, uint64_t seed) = 0;
  /// One entry a scene, in the order of build.
  virtual void load_data(std::vector<TrainingData> data) = 0;
  /// What training will take. Asked before load_data for all of it, later for the parameters alone (photos: none).
  virtual MemoryPlan memory(const PhotoSizes& photos) const = 0;
  virtual Params& parameters() = 0;
  virtual std::vector<LearningRate> learning_rates(const Progress& progress) const = 0;
  virtual AdamSettings adam() const { return {}; }
  /// The loss of one step, as a lazy graph.
  virtual Tensor loss(const Progress& progress) = 0;
  /// The loss of one step and its gradients; a method that cannot hold the graph of a whole step overrides it.
  virtual Gradients gradients(const Progress& progress, const Tensors& wanted);
  /// Tensors that metrics() will read: evaluated together with the loss.
  virtual Tensors observed() const { return {}; }
  /// Refresh the occupancy grid.
  virtual void after_step(const Progress&) {}
  /// After each step: parameters whose rows it made more, fewer or others, so that the optimiser's state follows.
  virtual RowMoves grow(const Progress&) { return {}; }
  /// The last step after which there may be more parameters, of a training that stands like this; 0: there never are.
  virtual int64_t grows_until(const Progress&) const { return 0; }
  /// Named figures of the last step for the progress line.
  virtual std::map<std::string, double> metrics() const { return {}; }
  virtual Picture render(const View& view) = 0;
  /// What the user should know about how it will begin with a scene, a line each. After build.
  virtual std::vector<std::string> warnings(const Scene&) const { return {}; }
  /// What it can do with actors and LiDAR; null: it knows neither.
  virtual Street* street() { return nullptr; }
  /// Of methods that learn from the assets of a run instead of captures: build is given that run's scenes, and the
  /// prior loads its assets in the place of load_data. Null: it learns from captures.
  virtual AssetPrior* prior() { return nullptr; }
  /// After build: takes the networks among the parameters of another run and leaves them frozen from here on, whatever
  /// the data. Fault::usage for methods whose networks belong to one scene, and for networks of other sizes.
  virtual void adopt_networks(const TensorMap& parameters);
  /// After adopt_networks and before load_data: codes that are learned from here on are held to what a diffusion of
  /// codes knows. The denoiser is called as long as this lives. Fault::usage for methods without such codes.
  virtual void adopt_prior(const CodeDenoiser& denoiser);
  /// What it learned, as 3D gaussians; nothing where it is made of something else.
  virtual std::optional<Gaussians> gaussians() const { return {}; }
  /// Before a checkpoint's parameters are put in: a method whose parameters grow takes their shapes from it.
  virtual void fit_to(const TensorMap&) {}
  /// What a resumed run needs beside parameters and optimiser; names without prefix.
  virtual TensorMap state() const { return {}; }
  virtual void restore(const TensorMap&) {}
};

}  // namespace cloam
