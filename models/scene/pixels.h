// The pixels of one split in memory: RGBA, masks and depths beside them, intrinsics that fit.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "models/scene/scene.h"

namespace cloam {

struct FramePixels {
  std::size_t frame = 0;  // index into Scene::frames
  int camera = 0;         // index into Pixels::cameras
  int width = 0;
  int height = 0;
  std::vector<std::uint8_t> rgba;  // [height, width, 4], straight alpha, 255 where the image has none
  std::vector<std::uint8_t> mask;  // [height, width], 255 used, 0 ignored; empty: all used
  std::vector<float> depth = {};   // [height, width] along the optical axis, scene units, 0 not known; empty: none is
};

struct Pixels {
  std::vector<Camera> cameras;  // at the loaded size, distinct ones only
  std::vector<FramePixels> frames;
  bool has_alpha = false;  // some pixel is not opaque
  std::vector<std::string> warnings;
};

}  // namespace cloam
