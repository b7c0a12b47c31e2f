// The pixels of one split in memory: RGBA, masks beside them, intrinsics that fit.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "models/scene/scene.h"

namespace cloam {

struct LoadOptions {
  int downscale = 1;
  bool skip_bad = false;  // drop damaged images with a warning instead of stopping
  MaskMeaning masks = MaskMeaning::ignore;
};

struct FramePixels {
  std::size_t frame = 0;  // index into Scene::frames
  int camera = 0;         // index into Pixels::cameras
  int width = 0;
  int height = 0;
  std::vector<std::uint8_t> rgba;  // [height, width, 4], straight alpha, 255 where the image has none
  std::vector<std::uint8_t> mask;  // [height, width], 255 used, 0 ignored; empty: all used
};

struct Pixels {
  std::vector<Camera> cameras;  // at the loaded size, distinct ones only
  std::vector<FramePixels> frames;
  bool has_alpha = false;  // some pixel is not opaque
  std::vector<std::string> warnings;
};

/// Where an image's size is not that of its camera, the intrinsics are scaled, with a warning, if the aspect ratio
/// agrees within 1 %. Fault::data for other sizes and for damaged images, naming the file. Fault::usage for a
/// factor that leaves no pixel. A mask's pixel is ignored if any of the pixels that it stands for is black; where masks
/// mean transparent, FramePixels::mask is empty and alpha is 0 there. Images that EXIF says are turned by a right angle
/// are turned if their camera has the turned size and not the stored one; else they are used as stored, with a warning.
Pixels load_images(const Scene& scene, Split split, const LoadOptions& options = {});

}  // namespace cloam
