// See train_pictures.h.
#include "cli/train_pictures.h"

#include <algorithm>

#include "cli/curves.h"
#include "cli/failure.h"
#include "cli/report_page.h"
#include "cli/run_pictures.h"
#include "cli/stop_signal.h"
#include "models/runs/scene_file.h"

namespace cloam {

namespace {
constexpr double kPictureShare = 0.05;                          // of the time that was trained, for pictures at its end
constexpr double kPartOfBudget = 0.04;                          // of a time budget, kept for them
constexpr double kLeastForPictures = 1, kMostForPictures = 20;  // seconds
}  // namespace

void TrainingPreviews::after_step(const StepReport& report, const fs::path& run) {
  const int64_t step = report.progress.step;
  if (!previews_ || step == report.end || stop_signal != 0) return;
  const double begun = steady_seconds();
  try {
    if (!pace_.is_due(step, report.seconds, report.seconds_left,
                      [&](double allowed) { return previews_->cost(allowed); }))
      return;
    view_.tell();
    previews_->make(step);
    write_curves(run);
  } catch (...) {
    view_.warning(text("no more previews while this training goes on: ", current_error().what()));
    previews_ = nullptr;
  }
  pace_.made(report.seconds + steady_seconds() - begun);
}

double kept_for_pictures(double budget) { return std::min(kMostForPictures, kPartOfBudget * budget); }

double time_for_pictures(const TrainResult& result, const std::optional<double>& budget) {
  if (result.interrupted) return 0;
  const double wanted = std::clamp(kPictureShare * result.seconds, kLeastForPictures, kMostForPictures);
  return budget ? std::clamp(*budget - seconds_since_start(), 0.0, wanted) : wanted;
}

void make_last_pictures(TrainJob& job, Previews* previews, double seconds, const Common& common) {
  const double begun = steady_seconds();
  if (previews && (!job.record.time_budget_seconds || previews->cost(seconds / 2) < seconds)) {
    const Camera& camera = previews->view().camera;
    say(common, text("rendering the preview, ", camera.width, "x", camera.height, " pixels"));
    say(common, text("preview ", previews->make(job.record.step).string(), "  (render | photo | error)"));
  }
  seconds -= job.record.time_budget_seconds ? steady_seconds() - begun : 0;
  if (learned_from_run(job.record)) {  // what shows its assets is the run that it learned from
    RestoredRun run = restore_run(job.folder);
    make_pictures(run, seconds, common);
    return;
  }
  RestoredRun run;
  run.folder = job.folder;
  run.record = job.record;
  run.scenes = read_scene_file(RunPaths{job.folder}.scene());
  run.method = std::move(job.method);
  make_pictures(run, seconds, common);
}

std::optional<Error> try_pictures(const std::function<void()>& make) {
  try {
    make();
    return std::nullopt;
  } catch (const Interrupted&) {
    return std::nullopt;  // by who does not want to wait for them
  } catch (...) {
    const Error error = current_error();
    return Error(error.fault(), text("the run is whole, but its pictures failed: ", error.what()));
  }
}

void write_report(const TrainJob& job, const Common& common) {
  write_curves(job.folder);
  write_report_page(job.folder, RunPaths{job.folder}.report());
  say(common, "report " + RunPaths{job.folder}.report().string());
}

}  // namespace cloam
