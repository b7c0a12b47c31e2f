// What a diffusion of codes adds to a training that learns codes: its term on the codes of the actors that a step sees,
// and, where a single image is learned from, denoising before that.
#pragma once
#include <functional>
#include <memory>
#include <string>

#include "models/io/safetensors.h"
#include "models/latents/code_denoiser.h"
#include "models/train/method.h"

namespace cloam {

struct CodePriorOptions {
  float weight = 0.1f;  // of the term: the norm of its gradient by codes over that of all other terms together
  bool through_network = false;
  int steps = 100;                  // of denoising
  float guidance = 1;               // guidance.h: strength
  float noise = 0;                  // deviation of what denoising begins with
  std::string start = "diffusion";  // or a guess without it (code_guess.h), and no term: "class-mean", "nearest"
};

// Streams of random numbers within a step, beside those of the method itself.
enum PriorStream : uint32_t { kPriorNoise = 64 };

/// Codes (means) [N,C,side,side] of the actors that a step meets, as gradients reach them; empty: none.
struct VisibleCodes {
  Tensor codes;
  Condition condition;
};

class CodeStart;
struct CodeRows;

class CodePrior {
 public:
  /// Fault::usage for options that cannot be. The denoiser is called as long as this lives.
  CodePrior(const CodeDenoiser& denoiser, const CodePriorOptions& options, uint64_t seed);
  ~CodePrior();
  /// The first steps of the training, from step 1 on, find these codes by what one image shows: denoised, or guessed as
  /// options.start says, where errors() tells how well the image is rendered at each of them. Later steps refine them.
  /// Fault::usage for a guess without the codes that the prior learned from.
  void find(CodeRows rows, std::function<std::vector<double>()> errors);
  bool finds() const { return start_ != nullptr; }

  /// Before a step is rendered.
  void begin_step(const Progress& progress);
  /// Adds the term to loss and gradients of the rendering, which are of `wanted`; or takes the codes' out, to guide
  /// denoising.
  void add(Step& step, const Tensors& wanted, const VisibleCodes& met, const Progress& progress);
  void end_step(const Progress& progress);
  /// What the term is multiplied by now; 0 until enough steps have measured.
  float weight() const;
  TensorMap state() const;
  void restore(const TensorMap& state);

 private:
  Tensor term(const VisibleCodes& met, const Progress& progress) const;

  CodeDenoiser denoiser_;
  CodePriorOptions options_;
  uint64_t seed_;
  std::unique_ptr<CodeStart> start_;
  float rendering_ = 0, term_ = 0;  // running means of the gradients' norms
  int64_t measured_ = 0;            // steps that are in them
  Tensor norms_;                    // both, of the last step, and how many shares of it met actors; empty: it met none
};

}  // namespace cloam
