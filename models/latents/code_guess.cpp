// See code_guess.h.
#include "models/latents/code_guess.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "runtime/error.h"
#include "runtime/ops.h"

namespace cloam {
namespace {

using Codes = std::vector<std::vector<float>>;

/// Evenly taken.
Codes at_most(const Codes& all, size_t most) {
  Codes some;
  const size_t count = std::min(all.size(), most);
  for (size_t i = 0; i < count; ++i) some.push_back(all[i * all.size() / count]);
  return some;
}

std::vector<float> mean_of(const Codes& codes) {
  std::vector<double> sum(codes.front().size());
  for (const std::vector<float>& code : codes)
    for (size_t i = 0; i < sum.size(); ++i) sum[i] += static_cast<double>(code[i]);
  std::vector<float> mean;
  for (const double value : sum) mean.push_back(static_cast<float>(value / static_cast<double>(codes.size())));
  return mean;
}

void append(std::vector<float>& to, const std::vector<float>& code) { to.insert(to.end(), code.begin(), code.end()); }

}  // namespace

CodeGuess::CodeGuess(const CodeDenoiser& denoiser, CodeGuessKind kind, int64_t steps, CodeRows rows,
                     std::function<std::vector<double>()> errors)
    : kind_(kind), steps_(steps), rows_(std::move(rows)), errors_(std::move(errors)) {
  const auto classes = rows_.condition.labels.at(0).to_host<int32_t>(),
             nights = rows_.condition.labels.at(1).to_host<int32_t>();
  for (size_t i = 0; i < rows_.rows.size(); ++i) {
    examples_.push_back(denoiser.examples ? denoiser.examples(classes[i], nights[i]) : Codes());
    if (examples_.back().empty())
      throw Error(Fault::usage, "prior.start: the codes that the prior learned from are not loaded");
  }
}

std::vector<float> CodeGuess::means() const {
  std::vector<float> means;
  for (const Codes& examples : examples_) append(means, mean_of(examples));
  return means;
}

void CodeGuess::show(int64_t step) {
  if (step == 1) rows_.write(means());
}

void CodeGuess::take(Step& rendering, const Tensors& wanted) { (void)rows_.take_gradient(rendering, wanted, 1); }

void CodeGuess::advance(int64_t step) {
  if (step == steps_ && kind_ == CodeGuessKind::nearest) choose();
}

/// All actors at once: each by the part of the image where it is.
void CodeGuess::choose() {
  std::vector<double> least(examples_.size(), std::numeric_limits<double>::infinity());
  std::vector<Codes> tried;
  for (const Codes& examples : examples_) tried.push_back(at_most(examples, kMostTried));
  Codes best;
  for (const Codes& codes : tried) best.push_back(codes.front());
  for (size_t candidate = 0; candidate < kMostTried; ++candidate) {
    std::vector<float> now;
    for (const Codes& codes : tried) append(now, codes[std::min(candidate, codes.size() - 1)]);
    rows_.write(now);
    const std::vector<double> errors = errors_();
    for (size_t i = 0; i < tried.size(); ++i)
      if (candidate < tried[i].size() && errors[i] < least[i]) least[i] = errors[i], best[i] = tried[i][candidate];
  }
  std::vector<float> chosen;
  for (const std::vector<float>& code : best) append(chosen, code);
  rows_.write(chosen);
}

}  // namespace cloam
