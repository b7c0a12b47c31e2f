// Loads a trained run, moves an actor of a street to its right, and renders the first view that was held out.
//   move_actor RUN OUT.png [ACTOR METRES]
#include <algorithm>
#include <cstdio>
#include <cstdlib>

#include "models/io/image.h"
#include "models/runs/restore_run.h"
#include "models/scene/edit.h"
#include "models/train/renders_views.h"
#include "runtime/error.h"

int main(int count, char** words) try {
  using namespace cloam;
  if (count != 3 && count != 5) throw Error(Fault::usage, "move_actor RUN OUT.png [ACTOR METRES]");
  const RestoredRun run = restore_run(words[1], [&](Scenes& scenes) {
    if (count == 5) apply(Shift{{std::atof(words[4]), 0, 0}}, scenes, AssetName{0, words[3]});
  });
  auto* views = as<RendersViews>(*run.method);
  if (!views) throw Error(Fault::usage, "the run's method renders no views");
  const Scene& scene = run.scenes.front();
  const auto held_out = [](const Frame& frame) { return frame.split == Split::test; };
  const auto frame = std::find_if(scene.frames.begin(), scene.frames.end(), held_out);
  if (frame == scene.frames.end()) throw Error(Fault::data, "no view was held out");
  const Camera camera = scaled(scene.cameras.at(static_cast<std::size_t>(frame->camera)), run.record.reading.downscale);
  const Picture picture = views->render(view_of(*frame, camera, 0));
  write_png(words[2], to_image(picture.rgb, picture.width, picture.height));
} catch (const cloam::Error& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return static_cast<int>(error.fault());
}
