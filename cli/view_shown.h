// What the viewer can show: a file of gaussians, a run, or a training. Each answers what it can; the rest is refused.
#pragma once
#include <nlohmann/json_fwd.hpp>

#include "cli/view_frames.h"
#include "models/gaussians/gaussians.h"

namespace cloam {

class Shown {
 public:
  virtual ~Shown() = default;
  /// scene.json of docs/viewer.md.
  virtual Answer scene() = 0;
  /// What splats.ply has.
  virtual Gaussians gaussians() const;
  /// What a page shows that has no program to render for it: recorded views of a street in the order of time, else a
  /// path around what the photos show.
  virtual std::vector<View> tour() const { return {}; }
  /// Number of the scene that requests are about.
  virtual int log() const { return 0; }
  virtual Answer frame(const FrameRequest& request, const std::function<void()>& between);
  virtual Answer actors(double time);
  virtual Answer thumbnail(const std::string& name);
  virtual Answer pick(const Json& request);
  virtual Answer edit(const Json& request);
  virtual Answer undo();
  virtual Answer save(const Json& request);

  // From any thread, for they need no device.
  virtual Answer photo(std::size_t frame);
  virtual Answer lidar(double time);
};

/// One line of JSON, whatever bytes its words have.
Answer json_answer(const nlohmann::ordered_json& json);

/// The bytes of a .ply file.
Answer ply_answer(const Gaussians& gaussians);

}  // namespace cloam
