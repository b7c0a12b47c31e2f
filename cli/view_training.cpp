// See view_training.h.
#include "cli/view_training.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <optional>

#include "cli/stop_signal.h"
#include "cli/view_scene.h"
#include "cli/view_server.h"
#include "models/methods/registry.h"

namespace cloam {
namespace {

using Report = nlohmann::ordered_json;

constexpr double kBetweenTells = 0.25;    // seconds
constexpr double kBetweenRevisions = 2;   // seconds, after which pages ask for the picture anew
constexpr double kLeastForFrames = 0.05;  // seconds that frames may take in any case

Report progress_of(const StepReport& report) {
  const auto psnr = report.metrics.find("psnr");
  return {{"step", report.progress.step},
          {"steps", report.end > 0 ? Report(report.end) : Report()},
          {"loss", report.loss},
          {"psnr", psnr != report.metrics.end() ? Report(psnr->second) : Report()}};
}

class TrainingShown final : public Shown {
 public:
  explicit TrainingShown(const FollowedTraining& training)
      : title_(training.title),
        method_(training.record.method),
        downscale_(training.record.reading.downscale),
        scene_(training.scene),
        frames_(require<RendersViews>(training.method, training.record.method, "--view")) {}

  Answer scene() override {
    Report json = scene_of_captures(title_, method_, scene_, downscale_);
    for (Report& camera : json["cameras"]) camera["photo"] = nullptr;
    json["lidar"] = false;
    json["revision"] = revision;
    json["training"] = progress;
    return json_answer(json);
  }
  Answer frame(const FrameRequest& request, const std::function<void()>& between) override {
    return frames_.frame(request, between);
  }

  Report progress = {{"step", 0}, {"steps", nullptr}, {"loss", nullptr}, {"psnr", nullptr}};
  int64_t revision = 0;

 private:
  std::string title_, method_;
  int downscale_;
  Scene scene_;
  FrameMaker frames_;
};

}  // namespace

class TrainingView::Parts {
 public:
  explicit Parts(const FollowedTraining& training)
      : shown(training), server(std::in_place, shown, jobs, events, training.port), address(server->address()) {
    jobs.stop_when([] { return stop_signal.load() != 0; });
  }
  ~Parts() { events.end("the training has ended"); }

  void step(const StepReport& report);

  JobQueue jobs;
  Events events;
  TrainingShown shown;
  std::optional<ViewServer> server;  // none once a page ended it
  std::string address;

 private:
  double told_ = 0, revised_ = 0;     // when, in steady seconds
  double free_from_ = 0, spent_ = 0;  // when frames were made last, and how long that took
};

void TrainingView::Parts::step(const StepReport& report) {
  if (server && server->was_asked_to_quit()) server.reset();
  if (!server) return;
  const double now = steady_seconds();
  shown.progress = progress_of(report);
  if (now - told_ > kBetweenTells) {
    told_ = now;
    events.tell("training", {{"training", shown.progress}});
  }
  if (now - revised_ > kBetweenRevisions) {
    revised_ = now;
    events.tell("revision", {{"revision", ++shown.revision}});
  }
  if (now < free_from_) return;
  jobs.run_for(std::max(spent_, kLeastForFrames));
  const double then = steady_seconds();
  spent_ = then - now;
  free_from_ = then + spent_;
}

TrainingView::TrainingView(const FollowedTraining& training) : parts_(std::make_unique<Parts>(training)) {}
TrainingView::~TrainingView() = default;
const std::string& TrainingView::address() const { return parts_->address; }
void TrainingView::step(const StepReport& report) { parts_->step(report); }

}  // namespace cloam
