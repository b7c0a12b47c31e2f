// What Street Gaussians' training asks of a picture besides its colours (Yan et al., ECCV 2024, section 3.4), and what
// it asks of Gaussians that no photo shows.
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

/// A photo as the street shows it.
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
/// Squares of what tells the colours of actors' Gaussians from their actor's mean colour, from all sides and at all
/// times: half their sum over those in the picture, per pixel. A Gaussian that photos show in a few hundredths of a
/// pixel hardly feels it. One behind another actor has next to no gradient else, of which Adam makes whole steps all
/// the same, towards the colours of what hides it.
Tensor hidden_term(const SeenStreet& seen, const StreetGaussiansModel& model);

}  // namespace cloam
