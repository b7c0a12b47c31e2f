// A trained diffusion as a prior of codes that rendering fits: score distillation, and denoising that a rendering
// guides. All in standardised codes x, the units that the diffusion learned in.
#pragma once
#include <functional>
#include <vector>

#include "models/diffusion/noise_schedule.h"

namespace cloam {

/// x^ of noisy [N,...] at times [N].
using CleanEstimate = std::function<Tensor(const Tensor& noisy, const std::vector<int32_t>& timesteps)>;

enum class NetworkGradient { left_out, included };

/// Score distillation: a scalar, 1/2 sum of sigma_t^2 |x - x^(x_t)|^2 with x_t = alpha_t x + sigma_t noise, whose
/// gradient by x [N,...] is sigma_t^2 (x - x^): x^ counts as a constant (DreamFusion, Poole et al. 2023, leave the
/// network's Jacobian out). `included` goes through the network too (SSDNeRF, Chen et al. 2023).
Tensor distillation(const NoiseSchedule& schedule, const CleanEstimate& clean, const Tensor& x,
                    const std::vector<int32_t>& timesteps, const Tensor& noise,
                    NetworkGradient network = NetworkGradient::left_out);

/// Rendering-guided denoising (SSDNeRF with omega = 1/2): x^ - lambda sigma g, where g, of x^'s shape [N,...], is the
/// gradient of a loss by x^, or by x_t where it was taken through the network. A loss may have any scale, so lambda is
/// chosen here, a row at a time: each goes `strength` sigma far (root mean square), since few pixels say as well as
/// many what an actor's paint is. Below a tenth of the largest row's gradient rows go less far in proportion; rows
/// without one, and all of them where g is 0, stay as they are.
Tensor guided_clean(const Tensor& clean, const Tensor& gradient, const Level& level, float strength);

}  // namespace cloam
