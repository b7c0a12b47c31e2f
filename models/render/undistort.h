// For methods that draw through pinholes alone: a pinhole for each lens, photos as it would have taken them, and its
// renders as the lens would have seen them, so that they are compared with the photo as it is.
#pragma once
#include "models/scene/pixels.h"
#include "models/scene/view.h"

namespace cloam {

/// No pinhole looks further than this to any side (radians; 140 degrees across): its image would be nearly all rim.
constexpr double kWidestPinhole = 70 * 3.14159265358979323846 / 180;

/// A pinhole whose image covers what the lens sees, up to kWidestPinhole, as fine as the lens at its middle; coarser
/// where that would take more than four times the lens's pixels. A pinhole is itself.
Camera pinhole_around(const Camera& lens);

/// A pinhole whose whole image the lens sees, as large as that allows about the axis; else as pinhole_around. A pinhole
/// is itself.
Camera pinhole_within(const Camera& lens);

/// Where one camera sees what the pixels of another show, both from one place.
struct PixelMap {
  int width = 0, height = 0;
  bool same = false;          // the two cameras are equal: points is empty, and nothing is to be done
  std::vector<float> points;  // [height, width, 2] pixels in `from`; NaN: `from` does not see it
};

/// For each pixel centre of `to`.
PixelMap pixel_map(const Camera& to, const Camera& from);

/// Which pixels of `to` have a place in `from`: [height, width], 255 or 0. Empty: all.
std::vector<std::uint8_t> seen(const PixelMap& map);

/// The photo as `to` would have taken it, between pixels bilinearly, colours weighted by alpha. What `from` did not see
/// is masked out, as is what lies beside a pixel that is masked out; depths are the nearest pixel's. Its indices are
/// kept.
FramePixels resample(const FramePixels& photo, const PixelMap& map);

/// All photos as pinholes would have taken them: pinhole_around each camera, at the same index.
Pixels undistorted(const Pixels& photos);

/// The render as `to` sees it, bilinearly; depths where nothing is (0) have no part in their neighbours', actors are
/// the nearest pixel's. Zeros where `from` does not see.
Picture resample(const Picture& picture, const PixelMap& map);

}  // namespace cloam
