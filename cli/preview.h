// What a training shows while it goes on: render, photo and error of one view side by side, always the same one.
#pragma once
#include <filesystem>
#include <functional>
#include <optional>
#include <string>

#include "cli/progress.h"
#include "models/runs/captures.h"
#include "models/scene/view.h"
#include "models/train/capability.h"
#include "models/train/refines_cameras.h"
#include "models/train/renders_views.h"

namespace cloam {

/// When to make previews; the last step has one in any case, unless they are off.
struct PreviewWish {
  bool off = false;
  int64_t steps = 0;   // between two
  double seconds = 0;  // between two; both 0: seldom enough to cost little
};
/// "auto", "off", a number of steps, or a time with its unit: "30s", "5m". Fault::usage.
PreviewWish preview_wish(const std::string& word);

/// Decides after which steps a preview is made.
class PreviewPace {
 public:
  explicit PreviewPace(const PreviewWish& wish) : wish_(wish) {}
  /// now: seconds since training began. left: until it ends, if known: near the end only the last preview is made.
  /// cost: seconds that a preview takes, which may be made to take no more than `allowed`; asked when one may be due.
  bool is_due(int64_t step, double now, std::optional<double> left,
              const std::function<double(double allowed)>& cost) const;
  void made(double now);

 private:
  PreviewWish wish_;
  double made_at_ = 0;
  bool any_ = false;
};

/// The view that is shown: the first that is held out, else the first; at most kLargestPreview pixels wide and high,
/// fewer where rendering is slow.
constexpr int kLargestPreview = 640, kLeastPreview = 96;
struct PreviewFrame {
  FramePixels photo;
  View view;
  std::string name;
  bool held_out = false;
  int camera = 0;         // among Scene::cameras
  std::size_t place = 0;  // of a photo that was trained on, among those
};
PreviewFrame preview_frame(const Captures& captures);

class Previews {
 public:
  /// method: RendersViews.
  Previews(Method& method, PreviewFrame frame, std::filesystem::path run, EventLog& log)
      : method_(*as<RendersViews>(method)),
        cameras_(as<RefinesCameras>(method)),
        frame_(std::move(frame)),
        run_(std::move(run)),
        log_(log) {}
  /// RUN/preview/step_NNNNNN.png and its event; older ones are thinned out, so that no more than 100 stay. Changes
  /// nothing of the training. The file. Errors of the device and Fault::write.
  std::filesystem::path make(int64_t step);
  const View& view() const { return frame_.view; }
  /// Seconds that a preview takes: as the last did; of the first it is told from a few pixels, which are rendered for
  /// that. Where it would take longer than `allowed`, previews are smaller from then on, down to kLeastPreview pixels.
  double cost(double allowed);

 private:
  double probed_cost();
  /// As what was learned of its camera until now shows it.
  View view_now() const;

  double cost_ = 0;
  RendersViews& method_;
  const RefinesCameras* cameras_;
  PreviewFrame frame_;
  std::filesystem::path run_;
  EventLog& log_;
};

}  // namespace cloam
