// What the trainer promises to methods, shown with the smallest of them; and the geometry that a run keeps.
#include "models/train/trainer.h"

#include <doctest/doctest.h>

#include <filesystem>
#include <optional>

#include "models/data/recording_file.h"
#include "models/io/checkpoint.h"
#include "models/nn/params.h"
#include "models/runs/scene_file.h"
#include "models/train/optimiser.h"
#include "models/train/shares_networks.h"
#include "runtime/error.h"
#include "runtime/ops.h"
#include "tests/models/errors.h"
#include "tests/models/folder.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

constexpr double kFastSeconds = 1. / 128;  // of a step

/// Each parameter is drawn to 1. A scene's own is in the loss of every second step alone.
class TwoScenes final : public Method, public SharesNetworks {
 public:
  void configure(Config&) override {}
  void build(const Scenes&, uint64_t) override {
    const Scope scope{params_, "", 1};
    (void)scope.constant("network", {3}, 0.f);
    for (const char* plane : {"plane.0", "plane.1"}) (void)scope.constant(plane, {2, 2}, 0.f);
  }
  MemoryPlan memory(const PhotoSizes&) const override { return {}; }
  Params& parameters() override { return params_; }
  ParameterGroups groups() const override {
    ParameterGroup network{"network", 0.1f}, plane{"plane", 0.1f};
    network.frozen = frozen_;
    plane.sparse = true;
    return {network, plane};
  }
  void adopt_networks(const TensorMap& parameters) override {
    const float* values = reinterpret_cast<const float*>(parameters.at("network").data.data());
    assign({{params_.at("network"), from_host(std::vector<float>(values, values + 3), {3})}});
    frozen_ = true;
  }
  Tensor loss(const Progress& progress) {
    const Tensor& plane = params_.at(progress.step % 2 == 0 ? "plane.0" : "plane.1");
    clock_ += progress.step <= slow_steps_ ? slow_seconds_ : kFastSeconds;
    if (progress.step == diverges_at_) {
      if (diverges_once_) diverges_at_ = 0;
      return sum(sqrt(params_.at("network") * 0.f));  // 0, its gradient NaN
    }
    return sum(square(params_.at("network") - 1.f)) + sum(square(plane - 1.f));
  }
  Step step(const Progress& progress, const Tensors& wanted) override {
    fraction_ = progress.fraction();
    Step all = step_of(loss(progress), wanted);
    wanted_ = wanted.size();
    reached_ = 0;
    for (const Tensor& gradient : all.gradients) reached_ += bool(gradient);
    return all;
  }
  TensorMap state() const override {
    clock_ += save_seconds_;
    return {};
  }
  std::vector<float> values(const char* name) { return params_.at(name).to_host(); }

  size_t wanted_ = 0, reached_ = 0;
  float fraction_ = 0;
  bool diverges_once_ = false;
  int64_t slow_steps_ = 0, diverges_at_ = 0;
  double slow_seconds_ = 1. / 16, save_seconds_ = 0;
  mutable double clock_ = 0;  // by which steps and saves last what they are told to

 private:
  Params params_;
  bool frozen_ = false;
};

void train_to(TwoScenes& method, const fs::path& folder, int64_t steps) {
  TrainOptions options;
  options.steps = steps;
  train({method, folder, {}, nullptr, nullptr}, options, {});
}

}  // namespace

TEST_CASE("a sparse parameter that the loss does not reach costs no gradient and stands still") {
  const Folder folder;
  TwoScenes method;
  method.build({}, 1);
  train_to(method, folder.path, 1);
  CHECK(method.wanted_ == 3);
  CHECK(method.reached_ == 2);
  CHECK(method.values("plane.0") == std::vector<float>(4, 0.f));
  CHECK(method.values("plane.1")[0] == doctest::Approx(0.1));  // Adam's first step is as long as its rate
  const SafetensorsFile saved = load_latest_checkpoint(folder.path).file;
  CHECK(saved.tensors.contains("adam.m.plane.0"));
}

TEST_CASE("adopted networks stay as they were, have no optimiser state and are saved with the run") {
  const Folder folder;
  TwoScenes first, second;
  first.build({}, 1);
  second.build({}, 2);
  train_to(first, folder.path / "a", 4);
  second.adopt_networks(parameters_in(load_latest_checkpoint(folder.path / "a").file));
  train_to(second, folder.path / "b", 4);
  CHECK(second.wanted_ == 2);
  CHECK(second.values("network") == first.values("network"));
  CHECK(second.values("plane.0")[0] > 0.1f);
  const SafetensorsFile saved = load_latest_checkpoint(folder.path / "b").file;
  CHECK(saved.tensors.contains("param.network"));
  CHECK_FALSE(saved.tensors.contains("adam.m.network"));
  TwoScenes restored;
  restored.build({}, 3);
  restore_method(restored, saved);
  CHECK(restored.values("network") == first.values("network"));
}

TEST_CASE("a time budget is planned by the steps at first, and again when they have become faster") {
  const Folder folder;
  TwoScenes method;
  method.build({}, 1);
  method.slow_steps_ = 80;
  TrainOptions options;
  options.time_budget_seconds = 10;
  options.clock = [&method] { return method.clock_; };
  int64_t first = 0;
  TrainListener listener;
  listener.step = [&](const StepReport& report) {
    if (first == 0) first = report.progress.horizon;
  };
  const TrainResult result = train({method, folder.path, {}, nullptr, nullptr}, options, listener);
  // After a quarter of the budget (40 steps), 0.9 of the rest less half a second for saving: 6.25 s.
  CHECK(first == 40 + static_cast<int64_t>(6.25 / method.slow_seconds_));
  CHECK(result.horizon == result.step);
  CHECK(method.clock_ < 10);
  CHECK(method.clock_ > 8);
}

namespace {

struct Saves {
  std::vector<int64_t> steps;
  double seconds = 0;
  double left_at_end = 0;  // as told after the last step, with its save to come
};

/// Of a training of 200 steps of a minute each, without --save-every.
Saves saves_of_a_long_training(double save_seconds) {
  const Folder folder;
  TwoScenes method;
  method.build({}, 1);
  method.slow_steps_ = 200;
  method.slow_seconds_ = 60;
  method.save_seconds_ = save_seconds;
  TrainOptions options;
  options.steps = 200;
  options.clock = [&method] { return method.clock_; };
  Saves saves;
  TrainListener listener;
  listener.checkpoint = [&](int64_t step, const fs::path&) { saves.steps.push_back(step); };
  listener.step = [&](const StepReport& report) { saves.left_at_end = report.seconds_left.value_or(-1); };
  train({method, folder.path, {}, nullptr, nullptr}, options, listener);
  saves.seconds = save_seconds * static_cast<double>(saves.steps.size());
  return saves;
}

}  // namespace

TEST_CASE("a training saves every five minutes by itself, the last step in any case") {
  const Saves saves = saves_of_a_long_training(0);
  REQUIRE(saves.steps.size() == 40);
  CHECK(saves.steps.front() == 5);
  for (size_t i = 1; i < saves.steps.size(); ++i) CHECK(saves.steps[i] == saves.steps[i - 1] + 5);
  CHECK(saves.steps.back() == 200);
  CHECK(saves.left_at_end == 0);
}

TEST_CASE("saves that take long are as rare as keeps them below a fiftieth of the time") {
  const Saves saves = saves_of_a_long_training(12);
  REQUIRE(saves.steps.size() > 10);
  for (size_t i = 2; i + 1 < saves.steps.size(); ++i) CHECK(60. * (saves.steps[i] - saves.steps[i - 1]) >= 12 / 0.02);
  CHECK(saves.seconds < 0.025 * 200 * 60);  // the first comes before its cost is known
  CHECK(saves.left_at_end == doctest::Approx(12));
}

TEST_CASE("where saves take minutes, an hour of training is at risk, or ten times what a save takes") {
  const Saves hour = saves_of_a_long_training(240);
  REQUIRE(hour.steps.size() > 3);
  for (size_t i = 1; i + 1 < hour.steps.size(); ++i) CHECK(hour.steps[i] - hour.steps[i - 1] == 60);
  const Saves longer = saves_of_a_long_training(480);
  REQUIRE(longer.steps.size() > 2);
  for (size_t i = 1; i + 1 < longer.steps.size(); ++i) CHECK(longer.steps[i] - longer.steps[i - 1] == 80);
}

TEST_CASE("parameters that are no longer finite stop the training within ten steps, and no checkpoint is claimed") {
  const Folder folder;
  TwoScenes method;
  method.build({}, 1);
  method.diverges_at_ = 13;
  int64_t last = 0;
  TrainListener listener;
  listener.step = [&](const StepReport& report) { last = report.progress.step; };
  TrainOptions options;
  options.steps = 1000;
  const std::string message = error_of(
      [&] {
        train({method, folder.path, {}, nullptr, nullptr}, options, listener);
      },
      Fault::diverged);
  CHECK(last <= 23);
  CHECK(holds(message, "no checkpoint was saved"));
  CHECK_FALSE(fs::exists(folder.path / "latest.txt"));
}

namespace {

/// Forty steps with a checkpoint every five, of a method that has NaN in the gradients of step 13.
struct Diverging {
  Folder folder;
  std::vector<std::string> warnings;
  std::optional<std::string> error;
  SafetensorsFile last;
  Diverging(int64_t at, bool once) {
    TwoScenes method;
    method.build({}, 1);
    method.diverges_at_ = at;
    method.diverges_once_ = once;
    TrainOptions options;
    options.steps = 40;
    options.save_every = 5;
    TrainListener listener;
    listener.warning = [&](const std::string& warning) { warnings.push_back(warning); };
    try {
      train({method, folder.path, {}, nullptr, nullptr}, options, listener);
    } catch (const Error& caught) {
      CHECK(caught.fault() == Fault::diverged);
      error = caught.what();
    }
    last = load_latest_checkpoint(folder.path).file;
  }
};

}  // namespace

TEST_CASE("a training that diverged goes back to its checkpoint and names step and op when it does so again") {
  const Diverging diverging(13, false);
  REQUIRE(diverging.error.has_value());
  CHECK(holds(*diverging.error, "first non-finite value: "));
  CHECK(holds(*diverging.error, "made by ["));
  CHECK(holds(*diverging.error, "when the steps were taken again, at step 13; the checkpoint of step 10 is good"));
  REQUIRE(diverging.warnings.size() == 1);
  CHECK(holds(diverging.warnings[0], "taking the steps from 10 on again"));
  CHECK(diverging.last.metadata.at("step") == "10");
}

TEST_CASE("a value that is NaN once costs a training nothing but the steps since its checkpoint") {
  const Diverging once(13, true), never(0, false);
  CHECK(!once.error.has_value());
  REQUIRE(once.warnings.size() == 2);
  CHECK(holds(once.warnings[1], "is finite now: the device or its memory erred"));
  CHECK(once.last == never.last);
}

TEST_CASE("a training that was finished goes on at its last rates, and a stop on the way changes no bytes") {
  const Folder folder;
  const auto go_on = [&](const fs::path& run, int64_t steps, int64_t stop_after, const SafetensorsFile* from) {
    TwoScenes method;
    method.build({}, 1);
    TrainOptions options;
    options.steps = steps;
    options.stop_after = stop_after;
    const TrainResult result = train({method, run, {}, from, nullptr}, options, {});
    CHECK(method.fraction_ <= 1.f);
    return result;
  };
  CHECK(go_on(folder.path / "a", 40, 0, nullptr).horizon == 40);
  const SafetensorsFile finished = load_latest_checkpoint(folder.path / "a").file;
  const TrainResult whole = go_on(folder.path / "a", 60, 0, &finished);
  CHECK(whole.step == 60);
  CHECK(whole.horizon == 40);
  const SafetensorsFile wanted = load_latest_checkpoint(folder.path / "a").file;
  go_on(folder.path / "b", 60, 50, &finished);
  const SafetensorsFile half = load_latest_checkpoint(folder.path / "b").file;
  CHECK(go_on(folder.path / "b", 60, 0, &half).step == 60);
  CHECK(load_latest_checkpoint(folder.path / "b").file == wanted);
}

TEST_CASE("a training that is taken step by step, and saved between them, makes the bytes of train()") {
  const Folder folder;
  TrainOptions options;
  options.steps = 7;
  TwoScenes whole, stepped;
  whole.build({}, 1);
  stepped.build({}, 1);
  train({whole, folder.path / "whole", {}, nullptr, nullptr}, options, {});
  std::vector<int64_t> told, saved;
  TrainListener listener;
  listener.step = [&](const StepReport& report) { told.push_back(report.progress.step); };
  listener.checkpoint = [&](int64_t step, const fs::path&) { saved.push_back(step); };
  Training training({stepped, folder.path / "stepped", {}, nullptr, nullptr}, options, listener);
  while (training.step()) {
    CHECK(training.result().step == told.back());
    if (told.back() == 3) training.save();
  }
  CHECK_FALSE(training.step());
  for (int again = 0; again < 2; ++again) training.save();
  CHECK(told == std::vector<int64_t>{1, 2, 3, 4, 5, 6, 7});
  CHECK(saved == std::vector<int64_t>{3, 7});
  CHECK(training.result().horizon == 7);
  CHECK(load_latest_checkpoint(folder.path / "stepped").file == load_latest_checkpoint(folder.path / "whole").file);
}

TEST_CASE("rows that a gradient reaches decay towards zero, the others keep their values") {
  Params params;
  params["w"] = parameter({4.f, 4.f}, {2, 1});
  const ParameterGroups rates = {{.prefix = "", .rate = 0.1f, .sparse = true, .decay = 0.5f}};
  Optimiser optimiser(params, rates);
  optimiser.step(params, {from_host(std::vector<float>{1.f, 0.f}, {2, 1})}, rates, {1});
  // AdamW: 4 (1 - 0.1 0.5) less a first step as long as the rate.
  CHECK(params["w"].to_host()[0] == doctest::Approx(4 * 0.95 - 0.1));
  CHECK(params["w"].to_host()[1] == 4.f);
}

TEST_CASE("a dense parameter without a gradient goes on by its momentum") {
  Params params;
  params["w"] = parameter({0.f, 0.f}, {2});
  const ParameterGroups rates = {{"", 0.1f}};
  Optimiser optimiser(params, rates);
  Tensors first = {from_host(std::vector<float>{1.f, -1.f}, {2})}, none = {Tensor()};
  optimiser.expect(first);
  optimiser.step(params, first, rates, {1});
  const std::vector<float> before = params["w"].to_host();
  optimiser.expect(none);
  optimiser.step(params, none, rates, {2});
  CHECK(params["w"].to_host()[0] < before[0]);
}

TEST_CASE("scene.json keeps all that a model of a log is built from, for each scene") {
  Scene log;
  log.format = "PandaSet";
  log.is_log = log.night = log.metric = true;
  log.cameras = {{16, 12, 10, 11, 8, 6, CameraModel::pinhole, {}, 0, 0}};
  Frame frame;
  frame.name = frame.image = "camera/front_camera/07.jpg";
  frame.sensor = "front_camera";
  frame.step = 7;
  frame.timestamp = 1557539924.4499;
  frame.split = Split::unused;
  frame.world_from_camera(0, 3) = 0.1;
  log.frames = {frame};
  Eigen::Matrix4d pose = Eigen::Matrix4d::Identity();
  pose(1, 3) = 1.0 / 3.0;
  log.sweeps = {{"lidar/07.pkl.gz", 1557539924.5, pose, 7, Split::test}};
  log.sweeps[0].velocity = {0.1, 2.0 / 3.0, 0};
  log.sweeps[0].second_lidar = {0, 0.5, 1.0 / 7.0};
  log.recording = pandaset_recording();
  log.actors = {{"a", "Car", {2, 4, 1.5}, true, {{7, 1557539924.5, pose}}, AssetName{1, "b"}},
                {"b", "Bus", {3, 9, 3}, false, {}, {}}};
  Scene photos;
  photos.cameras = log.cameras;
  photos.frames = {Frame{}};

  const Folder folder;
  write_scenes(folder.path / "scene.json", {log, photos});
  const Scenes read = read_scene_file(folder.path / "scene.json");
  REQUIRE(read.size() == 2);
  const Scene& back = read[0];
  CHECK((back.is_log && back.night && back.metric));
  CHECK(back.frames[0].sensor == "front_camera");
  CHECK(back.frames[0].step == 7);
  CHECK(back.frames[0].timestamp == frame.timestamp);
  CHECK(back.frames[0].split == Split::unused);
  CHECK(back.frames[0].world_from_camera == frame.world_from_camera);
  REQUIRE(back.sweeps.size() == 1);
  CHECK(back.sweeps[0].file == "lidar/07.pkl.gz");
  CHECK(back.sweeps[0].timestamp == 1557539924.5);
  CHECK(back.sweeps[0].split == Split::test);
  CHECK(back.sweeps[0].world_from_lidar == pose);
  CHECK(back.sweeps[0].velocity == log.sweeps[0].velocity);
  CHECK(back.sweeps[0].second_lidar == log.sweeps[0].second_lidar);
  CHECK(back.recording == log.recording);
  REQUIRE(back.actors.size() == 2);
  CHECK(back.actors[0].label == "Car");
  CHECK(back.actors[0].size == log.actors[0].size);
  CHECK(back.actors[0].stationary);
  CHECK(back.actors[0].boxes[0].world_from_box == pose);
  CHECK(back.actors[0].boxes[0].step == 7);
  CHECK(back.actors[0].asset == log.actors[0].asset);
  CHECK_FALSE(back.actors[1].asset);
  CHECK_FALSE(read[1].is_log);
  CHECK_FALSE(read[1].frames[0].timestamp);
}
