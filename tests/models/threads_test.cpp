// Two threads that train and render at once make the bytes of one after the other.
#include <doctest/doctest.h>

#include <barrier>
#include <future>

#include "tests/models/worlds.h"

using namespace cloam;

namespace {

struct Made {
  std::string checkpoint;  // the file's bytes
  std::vector<float> picture;
  bool operator==(const Made&) const = default;
};

Made train_and_render(const std::string& name, const Worlds& worlds) {
  const Folder folder;
  const auto method = configured(name, small_settings(name));
  load_world(*method, worlds);
  TrainOptions options;
  options.steps = 6;
  const TrainResult result = train({*method, folder.path, {}, nullptr, nullptr}, options, {});
  const Scene& scene = worlds.scene_of(*method);
  return {content_of(result.checkpoint), shown(*method, view_of(scene.frames.front(), scene.cameras.front(), 0)).rgb};
}

}  // namespace

TEST_CASE("two threads that train and render at once make the bytes of one after the other") {
  const Worlds worlds;
  const std::vector<std::string> names = {"nerf", "splat", "street-gaussians", "neurad", "genassets"};
  std::vector<Made> alone;
  for (const std::string& name : names) alone.push_back(train_and_render(name, worlds));
  for (size_t i = 0; i < 2 * names.size(); i++) {
    const size_t a = i % names.size(), b = (i + 1 + i / names.size()) % names.size();
    CAPTURE(names[a]);
    CAPTURE(names[b]);
    std::barrier start(2);
    const auto work = [&](size_t which) {
      start.arrive_and_wait();
      return train_and_render(names[which], worlds);
    };
    auto other = std::async(std::launch::async, work, b);
    CHECK(work(a) == alone[a]);
    CHECK(other.get() == alone[b]);
  }
}
