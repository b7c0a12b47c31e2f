// Capability: learns latent codes of actors, which a diffusion of such codes can hold to what it knows.
#pragma once
#include "models/latents/code_denoiser.h"

namespace cloam {

class TakesPrior {
 public:
  virtual ~TakesPrior() = default;
  /// After the networks are adopted and before the data are loaded: codes that are learned from here on are held to
  /// what the diffusion knows. The denoiser is called as long as this lives. Fault::usage for codes of another size.
  virtual void adopt_prior(const CodeDenoiser& denoiser) = 0;
};

}  // namespace cloam
