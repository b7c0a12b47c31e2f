// See street_gaussians_losses.h.
#include "models/methods/street_gaussians_losses.h"

#include "models/street/least_errors.h"

namespace cloam {
namespace {

constexpr float kLeastLight = 1e-4f;  // of a logarithm's argument

/// Mean over the pixels that count.
Tensor mean_of(const SeenStreet& seen, const Tensor& x) {
  return sum(seen.used ? x * seen.used : x) * (1 / seen.pixels);
}

/// An integer mask. A pixel is of the sky or of matter or neither, and may be an actor's besides.
Tensor is(PixelKind kind, const SeenStreet& seen) {
  const Tensor kinds = cast(seen.hints.kinds, DType::f32), is_actor = Tensor(static_cast<float>(kActorPixel)) <= kinds;
  return kind == kActorPixel
             ? is_actor
             : equal(where(is_actor, kinds - static_cast<float>(kActorPixel), kinds), static_cast<float>(kind));
}

Tensor entropy(const Tensor& p) { return -(p * log(p) + (1.f - p) * log(1.f - p)); }

/// [A], of rows [A,...].
Tensor squares_of(const Tensor& rows) { return sum(square(reshape(rows, {rows.dim(0), -1})), {{1}}); }

}  // namespace

Tensor sky_term(const SeenStreet& seen) {
  const Tensor through = maximum(seen.drawn.transmittance, kLeastLight),
               opacity = maximum(1.f - seen.drawn.transmittance, kLeastLight);
  return -mean_of(seen,
                  where(is(kSkyPixel, seen), log(through), where(is(kMatterPixel, seen), log(opacity), Tensor(0.f))));
}

/// Each pixel teaches its nearest texel alone. Whatever else a picture would teach it, through things or at the margin
/// of what bilinear reading reaches, has next to no gradient, of which Adam makes whole steps all the same: texels
/// behind a car that is always there would take on any colour, and glow once it is moved.
Tensor sky_colour_term(const SeenStreet& seen, const Tensor& sky, const Tensor& photo) {
  const Tensor kinds = cast(seen.hints.kinds, DType::f32);
  const Tensor counts = where(equal(kinds, static_cast<float>(kSkyPixel)), Tensor(1.f),
                              where(equal(kinds, 0.f), Tensor(kMaybeSky), Tensor(0.f)));
  return mean_of(seen, unsqueeze(counts, 0) * abs(sky - photo));
}

Tensor lidar_term(const SeenStreet& seen) {
  const auto at_returns = [&](const Tensor& plane) {
    return gather_rows(reshape(plane, {plane.numel()}), seen.hints.pixels);
  };
  const Tensor opacity = maximum(1.f - at_returns(seen.drawn.transmittance), 1e-2f);
  return mean_without_worst(abs(at_returns(slice(seen.drawn.planes, 0, 3, 4)) / opacity - seen.hints.depths));
}

Tensor actors_term(const SeenStreet& seen) {
  const Tensor plane = slice(seen.drawn.planes, 0, 4, 5);
  const Tensor share =
      clamp(reshape(plane, seen.drawn.transmittance.shape()), Tensor(kLeastLight), Tensor(1.f - kLeastLight));
  return mean_of(seen, where(is(kActorPixel, seen), entropy(share), -log(1.f - share)));
}

Tensor outside_term(const StreetGaussiansModel& model) {
  const Cloud actors = model.things(0).model.cloud;
  const Tensor metres = sum(relu(abs(actors.means) - model.half_sizes()), {{1}});
  return mean(metres * sigmoid(actors.opacities));
}

Tensor hidden_term(const SeenStreet& seen, const StreetGaussiansModel& model) {
  const ThingsModel actors = model.things(0);
  const Harmonics& colours = actors.model.harmonics;
  Tensor squares =
      squares_of(colours.first - stop_gradient(model.mean_of_actor(colours.first))) + squares_of(colours.rest);
  if (actors.waves) squares = squares + squares_of(actors.waves);
  const int64_t all = seen.drawn.seen.dim(0), first = all - squares.dim(0);
  return sum(cast(slice(listed(seen.drawn.tiles), 0, first, all), DType::f32) * squares) * (0.5f / seen.pixels);
}

}  // namespace cloam
