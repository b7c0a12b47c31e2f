// What Street Gaussians' training asks besides the colours of a picture (Yan et al., ECCV 2024, section 3.4).
#pragma once
#include <string>

#include "models/methods/street_gaussians_model.h"
#include "models/splat/draw.h"
#include "models/street/photo_hints.h"

namespace cloam {

/// What a pixel that may be of the sky or not counts for its colours; one that is: 1.
constexpr float kMaybeSky = 0.1f;

/// What is known of a photo beside its colours, on the device.
struct PhotoHints {
  double time = 0;
  std::string sensor;
  Tensor kinds;           // u8 [H,W] of PixelKind
  Tensor pixels, depths;  // int32 [N], [N]; empty: LiDAR saw nothing there
  Tensor directions;      // [H*W,3] of its camera's pixels; shared by photos of one camera
};

/// What the model draws in the place of a photo.
struct SeenStreet {
  const PhotoHints& hints;
  Drawn drawn;
  Tensor used;       // [H,W], 0 where a mask says ignore; empty: all
  float pixels = 0;  // of the photo
};

/// Cross-entropy of opacity with what LiDAR says; what nobody knows has no part. A scalar, as all of these.
Tensor sky_term(const SeenStreet& seen);
/// L1 of the sky's colours [3,H,W], as its camera has them, and the photo's, where nothing is known to stand before it.
Tensor sky_colour_term(const SeenStreet& seen, const Tensor& sky, const Tensor& photo);
/// Metres. Of the returns with the least errors: LiDAR and camera do not see the same at edges. Needs returns, and
/// depth as the fourth plane that was drawn.
Tensor lidar_term(const SeenStreet& seen);
/// Where boxes are, a pixel shows an actor or it does not (entropy); elsewhere it shows none (Yan et al. 2024, L_reg).
/// Needs the actors' share as the fifth plane that was drawn.
Tensor actors_term(const SeenStreet& seen);
/// Metres by which actors' Gaussians lie outside their boxes, times their opacity: the mean.
Tensor outside_term(const StreetGaussiansModel& model);
/// Half the sum of squares of how far colours of actors' Gaussians in the picture are from their actor's mean, and of
/// what depends on side and time, divided by the photo's pixels. Its gradient, times a weight of 0.03, is that of an
/// absolute error at 0.4 pixels for a colour that is 0.28 off. A Gaussian behind another actor has next to no gradient
/// otherwise, of which Adam makes whole steps all the same, towards the colours of what hides it.
Tensor hidden_term(const SeenStreet& seen, const StreetGaussiansModel& model);

}  // namespace cloam
