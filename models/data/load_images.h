// The images of one split, read into memory.
#pragma once
#include "models/scene/pixels.h"

namespace cloam {

struct LoadOptions {
  int downscale = 1;
  bool skip_bad = false;  // drop damaged images with a warning instead of stopping
  MaskMeaning masks = MaskMeaning::ignore;
};

/// Where an image's size is not that of its camera, the intrinsics are scaled, with a warning, if the aspect ratio
/// agrees within 1 %. Fault::data for other sizes and for damaged images, naming the file. Fault::usage for a
/// factor that leaves no pixel. A mask's pixel is ignored if any of the pixels that it stands for is black; where masks
/// mean transparent, FramePixels::mask is empty and alpha is 0 there. Images that EXIF says are turned by a right angle
/// are turned if their camera has the turned size and not the stored one; else they are used as stored, with a warning.
Pixels load_images(const Scene& scene, Split split, const LoadOptions& options = {});

}  // namespace cloam
