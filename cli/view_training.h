// A training that pages follow: frames of the parameters as they are now, rendered between steps on its own thread.
#pragma once
#include <memory>
#include <string>

#include "models/runs/run_folder.h"
#include "models/scene/scene.h"
#include "models/train/trainer.h"

namespace cloam {

struct FollowedTraining {
  std::string title;
  const RunRecord& record;
  const Scene& scene;  // copied
  Method& method;
  int port = 0;  // 0: any that is free
};

class TrainingView {
 public:
  /// Serves from here on; the method must outlive this. Fault::usage for one that renders no views, and for a port that
  /// is taken.
  explicit TrainingView(const FollowedTraining& training);
  ~TrainingView();
  TrainingView(const TrainingView&) = delete;
  TrainingView& operator=(const TrainingView&) = delete;

  const std::string& address() const;
  /// After a step: tells the pages, and renders what they ask for, for no longer than the training had since the last
  /// time. Nothing here changes what is trained.
  void step(const StepReport& report);

 private:
  class Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace cloam
