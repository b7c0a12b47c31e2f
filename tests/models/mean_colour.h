// What a model must clear.
#pragma once
#include "models/data/load_images.h"
#include "models/eval/baselines.h"
#include "models/eval/pictures.h"

namespace cloam {

/// Mean PSNR of the test photos against the mean colour of the training photos.
inline double mean_colour_figure(const Scene& scene) {
  const Pixels train = load_images(scene, Split::train), test = load_images(scene, Split::test);
  const Baselines baselines(scene, train);
  double sum = 0;
  for (const FramePixels& frame : test.frames) {
    const std::vector<float> rgb = on_white(frame);
    sum += baselines.score({scene, frame, rgb}).mean_colour;
  }
  return sum / static_cast<double>(test.frames.size());
}

}  // namespace cloam
