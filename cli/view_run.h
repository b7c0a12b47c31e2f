// A run as the viewer shows it: rendered by its method, its actors edited.
#pragma once
#include <optional>

#include "cli/view_edits.h"
#include "cli/view_events.h"
#include "cli/view_recorded.h"
#include "cli/view_shown.h"
#include "models/street/street.h"

namespace cloam {

struct ViewedRun {
  RestoredRun run;
  int log = 0;
  std::string title;
  std::string prior;                                  // as typed
  std::function<std::filesystem::path()> find_prior;  // as ActorEdits takes it
};

class RunShown final : public Shown {
 public:
  /// Fault::usage for a method that renders nothing. Revisions are told to `events`.
  RunShown(ViewedRun viewed, Events& events);
  /// Compiles what a frame takes, and measures how long one takes.
  void warm_up();

  Answer scene() override;
  Gaussians gaussians() const override;
  std::vector<View> tour() const override;
  int log() const override { return log_; }
  Answer frame(const FrameRequest& request, const std::function<void()>& between) override;
  Answer actors(double time) override;
  Answer thumbnail(const std::string& name) override;
  Answer pick(const Json& request) override;
  Answer edit(const Json& request) override;
  Answer undo() override;
  Answer save(const Json& request) override;
  Answer photo(std::size_t frame) override { return recorded_.photo(frame); }
  Answer lidar(double time) override { return recorded_.lidar(time); }

 private:
  const Scene& scene_shown() const { return run_.scenes[static_cast<std::size_t>(log_)]; }
  Street& street();
  Answer changed();
  void show_edits();

  RestoredRun run_;
  const int log_;
  const std::string title_;
  Events& events_;
  FrameMaker frames_;
  Recorded recorded_;
  ViewEdits edits_;
  bool wears_generated_ = false;  // the method holds generated assets
  int64_t revision_ = 0;
  std::map<std::string, std::string> thumbnails_;  // JPEG, by what they show
};

}  // namespace cloam
