// Frames for the viewer's mouse: what a page asks for, how coarse a picture has to be to come in time, and the picture.
#pragma once
#include <functional>
#include <string>
#include <vector>

#include "cli/view_jobs.h"
#include "models/io/json.h"
#include "models/train/renders_views.h"

namespace cloam {

struct FrameRequest {
  std::string client;
  int64_t number = 0;
  int level = 0;  // 0 coarse, 1 middle, 2 full
  bool png = false;
  View view;
};

/// The camera of a request and what it looks at; of the scene with that number. Fault::data for what is no camera.
View view_in(const Json& request, int scene);
FrameRequest frame_request(const Json& request, int scene);

/// How long pictures take: a constant and a part for each pixel, learned from those that were made. What was measured
/// last counts most.
class FramePace {
 public:
  void add(double pixels, double seconds);
  bool is_known() const { return weight_ > 0; }
  /// Once it is known.
  double seconds_for(double pixels) const;

 private:
  double weight_ = 0, pixels_ = 0, seconds_ = 0, squares_ = 0, products_ = 0;  // weighted sums
};

class FrameMaker {
 public:
  explicit FrameMaker(RendersViews& renders) : renders_(&renders) {}
  /// Another model of the same kind: what was learned of its pace stays.
  void show(RendersViews& renders) { renders_ = &renders; }
  /// Compiles what rendering takes and measures its pace, with small pictures of these views, one at least.
  void warm_up(const std::vector<View>& views);
  /// As JPEG, or PNG if asked for; headers X-Number, X-Scale, X-Milliseconds. The full level is what `render` makes.
  Answer frame(const FrameRequest& request, const std::function<void()>& between);

 private:
  int scale_for(const FrameRequest& request) const;
  Picture render(View view);

  RendersViews* renders_;
  FramePace pace_;
};

}  // namespace cloam
