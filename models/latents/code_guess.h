// What one image can be told without a network: codes of its actors that are typical, or that have been seen. The
// guesses that rendering-guided denoising (code_denoising.h) must beat.
#pragma once
#include <functional>

#include "models/latents/code_rows.h"

namespace cloam {

/// class_mean: the mean of the training codes of an actor's class and time of day. nearest: that of them with which the
/// image is rendered best.
enum class CodeGuessKind { class_mean, nearest };

/// In the first steps the codes stand still at their class's mean, while the background is learned. Then, for
/// `nearest`, each actor takes the best of its class's training codes.
class CodeGuess final : public CodeStart {
 public:
  /// At most so many codes of a class are tried, evenly taken: each is an image rendered.
  static constexpr size_t kMostTried = 64;
  /// errors: what the image says of the codes as they are now, a number an actor in the order of `rows`, smaller is
  /// better. Fault::usage where the denoiser has no examples.
  CodeGuess(const CodeDenoiser& denoiser, CodeGuessKind kind, int64_t steps, CodeRows rows,
            std::function<std::vector<double>()> errors);
  bool includes(int64_t step) const override { return step <= steps_; }
  void show(int64_t step) override;
  void take(Step& rendering, const Tensors& wanted) override;
  void advance(int64_t step) override;

 private:
  std::vector<float> means() const;
  void choose();

  CodeGuessKind kind_;
  int64_t steps_;
  CodeRows rows_;
  std::function<std::vector<double>()> errors_;
  std::vector<std::vector<std::vector<float>>> examples_;  // of each row
};

}  // namespace cloam
