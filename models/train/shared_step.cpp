// See shared_step.h.
#include "models/train/shared_step.h"

#include <cstring>
#include <optional>

#include "runtime/error.h"
#include "runtime/op.h"

namespace cloam {
namespace {

/// What ranks tell each other of a share beside its floats.
struct Told {
  std::vector<double> numbers;       // weight, loss, whether each buffer has a gradient, counts, figures
  std::vector<std::string> figures;  // their names
};

std::string packed(const Told& told) {
  std::string out(reinterpret_cast<const char*>(told.numbers.data()), told.numbers.size() * sizeof(double));
  std::string names;
  for (const std::string& name : told.figures) names += name + '\n';
  return std::to_string(out.size()) + '\n' + out + names;
}

Told unpacked(const std::string& text) {
  const size_t line = text.find('\n'), bytes = std::stoull(text);
  Told told;
  told.numbers.resize(bytes / sizeof(double));
  std::memcpy(told.numbers.data(), text.data() + line + 1, bytes);
  for (size_t at = line + 1 + bytes; at < text.size();) {
    const size_t end = text.find('\n', at);
    told.figures.push_back(text.substr(at, end - at));
    at = end + 1;
  }
  return told;
}

/// One step's sums over shares.
class SummedStep {
 public:
  SummedStep(Optimiser& optimiser, const Sharing& sharing) : optimiser_(optimiser), sharing_(sharing) {}
  /// An evaluated share of this rank, while every other rank adds one, too.
  void add(const Step& step);
  /// Into the last share's step, on all ranks.
  void take(Step& step);
  TakenStep means() const;

 private:
  Told told_of(const Step& step, const Tensors& buffers) const;
  bool has_gradient(size_t buffer) const;
  void note(const Told& told, size_t counts);
  void add_buffer(size_t at, const Tensor& mine, const Shape& shape);

  Optimiser& optimiser_;
  const Sharing& sharing_;
  std::vector<Told> round_;     // of the shares that the ranks add at a time, by rank
  std::vector<float> weights_;  // theirs
  std::vector<std::optional<OrderedSum>> buffers_, sums_;
  std::vector<double> counts_;
  double weight_ = 0, loss_ = 0;
  struct Mean {
    double sum = 0, weight = 0;
  };
  std::map<std::string, Mean> figures_;
};

/// Its weight is that of all shares where a method says nothing else.
double weight_of(const Step& step, int64_t shares) {
  return step.weight > 0 ? step.weight : 1.0 / static_cast<double>(shares);
}

Told SummedStep::told_of(const Step& step, const Tensors& buffers) const {
  Told told;
  told.numbers = {weight_of(step, sharing_.shares), static_cast<double>(step.loss.item())};
  for (const Tensor& buffer : buffers) told.numbers.push_back(buffer ? 1 : 0);
  for (const double* count : step.counts) told.numbers.push_back(*count);
  for (const Figure& figure : step.figures) {
    told.numbers.push_back(figure.value());
    told.figures.push_back(figure.name);
  }
  return told;
}

constexpr size_t kBeforeBuffers = 2;  // numbers

bool SummedStep::has_gradient(size_t buffer) const {
  return std::any_of(round_.begin(), round_.end(),
                     [&](const Told& told) { return told.numbers[kBeforeBuffers + buffer] > 0; });
}

void SummedStep::note(const Told& told, size_t counts) {
  const double weight = told.numbers[0];
  weights_.push_back(static_cast<float>(weight));
  weight_ += weight;
  loss_ += weight * told.numbers[1];
  const size_t figures = told.numbers.size() - told.figures.size();
  counts_.resize(counts);
  for (size_t i = 0; i < counts; ++i) counts_[i] += told.numbers[figures - counts + i];
  for (size_t i = 0; i < told.figures.size(); ++i) {
    Mean& mean = figures_[told.figures[i]];
    mean.sum += weight * told.numbers[figures + i];
    mean.weight += weight;
  }
}

void SummedStep::add_buffer(size_t at, const Tensor& mine, const Shape& shape) {
  const auto count = static_cast<size_t>(numel(shape));
  std::optional<OrderedSum>& sum = buffers_[at];
  if (!sum) sum.emplace(sharing_.ranks, count);
  sum->add(mine ? mine.to_host() : std::vector<float>(count, 0.f), weights_);
}

void SummedStep::add(const Step& step) {
  const Tensors buffers = optimiser_.buffers_of(step.gradients);
  round_.clear();
  weights_.clear();
  for (const std::string& text : gathered(sharing_.ranks, packed(told_of(step, buffers))))
    round_.push_back(unpacked(text));
  for (const Told& told : round_) note(told, step.counts.size());
  const std::vector<Shape> shapes = optimiser_.buffer_shapes();
  buffers_.resize(buffers.size());
  for (size_t i = 0; i < buffers.size(); ++i)
    if (has_gradient(i)) add_buffer(i, buffers[i], shapes[i]);
  sums_.resize(step.sums.size());
  for (size_t i = 0; i < step.sums.size(); ++i) {
    if (!sums_[i]) sums_[i].emplace(sharing_.ranks, static_cast<size_t>(step.sums[i].numel()));
    sums_[i]->add(step.sums[i].to_host(), std::vector<float>(weights_.size(), 1.f));
  }
}

void SummedStep::take(Step& step) {
  Tensors buffers;
  const std::vector<Shape> shapes = optimiser_.buffer_shapes();
  for (size_t i = 0; i < buffers_.size(); ++i)
    buffers.push_back(buffers_[i] ? from_host(buffers_[i]->take(), shapes[i]) : Tensor());
  optimiser_.take_buffers(buffers, step.gradients);
  for (size_t i = 0; i < sums_.size(); ++i) assign({{step.sums[i], from_host(sums_[i]->take(), step.sums[i].shape())}});
  for (size_t i = 0; i < counts_.size(); ++i) *step.counts[i] = counts_[i];
}

TakenStep SummedStep::means() const {
  TakenStep taken{loss_ / weight_};
  for (const auto& [name, mean] : figures_) taken.figures[name] = mean.sum / mean.weight;
  return taken;
}

Step evaluated_step(Method& method, Optimiser& optimiser, const Progress& progress) {
  Step step = method.step(progress, optimiser.wanted(method.parameters()));
  optimiser.expect(step.gradients);
  eval_step(step);
  return step;
}

}  // namespace

void eval_step(const Step& step) {
  Tensors results = step.more;
  results.insert(results.end(), step.sums.begin(), step.sums.end());
  results.insert(results.end(), step.gradients.begin(), step.gradients.end());
  for (const Figure& figure : step.figures) results.push_back(figure.pending);
  results.push_back(step.loss);
  std::erase_if(results, [](const Tensor& x) { return !x; });
  eval(results);
}

TakenStep take_step(Method& method, Optimiser& optimiser, const Progress& progress, const Sharing& sharing) {
  const auto update = [&](const Step& step) {
    optimiser.step(method.parameters(), step.gradients, method.groups(), progress);
  };
  if (sharing.shares == 1) {
    const Step step = evaluated_step(method, optimiser, progress);
    update(step);
    TakenStep taken{static_cast<double>(step.loss.item())};
    for (const Figure& figure : step.figures) taken.figures[figure.name] = figure.value();
    return taken;
  }
  SummedStep sum(optimiser, sharing);
  Step step;
  for (int64_t first = 0; first < sharing.shares; first += sharing.ranks.size()) {
    Progress part = progress;
    part.share = {first + sharing.ranks.rank(), sharing.shares};
    step = evaluated_step(method, optimiser, part);
    sum.add(step);
  }
  sum.take(step);
  update(step);
  return sum.means();
}

}  // namespace cloam
