// The pictures of a training: previews while it goes on, and what is shown of the run at its end.
#pragma once
#include <functional>
#include <optional>

#include "cli/preview.h"
#include "models/runs/training_job.h"
#include "runtime/error.h"

namespace cloam {

/// Previews that are made while a training goes on; the first that fails is the last.
class TrainingPreviews {
 public:
  TrainingPreviews(Previews* previews, const PreviewWish& wish, ProgressView& view)
      : previews_(previews), pace_(wish), view_(view) {}
  void after_step(const StepReport& report, const std::filesystem::path& run);

 private:
  Previews* previews_;
  PreviewPace pace_;
  ProgressView& view_;
};

/// Seconds of a time budget that are kept for pictures at its end.
double kept_for_pictures(double budget);

/// Pictures are no reason to miss a time budget, nor to keep those waiting who asked to stop. Seconds for them; 0:
/// none.
double time_for_pictures(const TrainResult& result, const std::optional<double>& budget);

/// The last preview, and pictures from all around. After the run is recorded: an interruption here loses nothing. Takes
/// the job's method. Errors as make_pictures.
void make_last_pictures(TrainJob& job, Previews* previews, double seconds, const Common& common);

/// RUN/curves.svg and RUN/report.html. Errors as write_report_page.
void write_report(const TrainJob& job, const Common& common);

/// Pictures are no part of the training, which is recorded: they may fail. What to say if they did.
std::optional<Error> try_pictures(const std::function<void()>& make);

}  // namespace cloam
