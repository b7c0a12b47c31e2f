// The images of one split, read into memory at once or when they are asked for.
#pragma once
#include "models/io/image.h"
#include "models/scene/photo_store.h"
#include "models/scene/resting_scene.h"

namespace cloam {

struct LoadOptions {
  int downscale = 1;
  bool skip_bad = false;  // drop damaged images with a warning instead of stopping
  MaskMeaning masks = MaskMeaning::ignore;
  bool depths = false;  // read depth maps, too
};

/// The photo of a frame as stored on the disk, its light as docs/formats.md has it: sRGB, at the capture's exposure.
Image photo_of(const Scene& scene, const Frame& frame);

/// Where an image's size is not that of its camera, the intrinsics are scaled, with a warning, if the aspect ratio
/// agrees within 1 %. Fault::data for other sizes and for damaged images, naming the file. Fault::usage for a
/// factor that leaves no pixel. A mask's pixel is ignored if any of the pixels that it stands for is black; where masks
/// mean transparent, FramePixels::mask is empty and alpha is 0 there. Images that EXIF says are turned by a right angle
/// are turned if their camera has the turned size and not the stored one; else they are used as stored, with a warning.
/// Depths are as depth_of (depth_map.h) has them, and 0 where a mask or alpha leaves the pixel out.
Pixels load_images(const Scene& scene, Split split, const LoadOptions& options = {});

/// Gives frames whose photo has another size than their camera, but its shape, one of the photo's size, with a warning.
/// Sizes that cannot be told are left to load_images.
void fit_cameras(Scene& scene);

/// The same images, decoded when they are asked for and kept as far as the store has room. Only their headers are read
/// here (with skip_bad all of them, once, since a damaged one takes no part from the start): what is damaged behind the
/// header is Fault::data for whoever asks for that image.
PhotoStore store_images(const RestingScene& scene, Split split, const LoadOptions& options,
                        const std::shared_ptr<HostStore>& store);

}  // namespace cloam
