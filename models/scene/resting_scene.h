// A scene of which a training needs now this part and now that: packed in memory, and unpacked for whoever asks. A
// hundred logs have a million poses, and a step looks at one log.
#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "models/io/host_store.h"
#include "models/scene/scene.h"

namespace cloam {

/// All of the scene, in a tenth to a third of its memory. The same scene gives the same bytes.
std::vector<std::uint8_t> packed(const Scene& scene);
/// The scene that was packed, to the bit. Fault::data for other bytes.
Scene unpacked_scene(std::span<const std::uint8_t> bytes);

/// A copy is the same scene.
class RestingScene {
 public:
  /// In memory as it is.
  RestingScene(Scene scene = {});  // NOLINT: a scene in memory is one
  /// Packed; unpacked ones are held as far as the store has room.
  RestingScene(const Scene& scene, const std::shared_ptr<HostStore>& store);

  /// It lives as long as the caller keeps it.
  std::shared_ptr<const Scene> get() const { return scene_[0]; }
  /// As HostStore::want.
  void want(int64_t moment) const { scene_.want(0, moment); }

 private:
  Stored<Scene> scene_;
};

}  // namespace cloam
