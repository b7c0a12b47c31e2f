// See shared_step.h.
#include "models/train/shared_step.h"

#include <algorithm>
#include <cstring>

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
  SummedStep(Optimiser& optimiser, const Sharing& sharing, OrderedSum& gradients, OrderedSum& sums)
      : optimiser_(optimiser), sharing_(sharing), gradients_(gradients), sums_(sums) {
    gradients_.begin();
    sums_.begin();
  }
  /// An evaluated share of this rank, while every other rank adds one, too.
  void add(const Step& step);
  /// Into the last share's step, on all ranks.
  void take(Step& step);
  TakenStep means() const;

 private:
  Told told_of(const Step& step, const Tensors& buffers) const;
  void hear(const Told& mine, size_t counts);
  bool has_gradient(size_t buffer) const;
  void note(const Told& told, size_t counts);
  void place_buffers();
  std::span<float> values_of(size_t buffer);
  void add_gradients(const Tensors& buffers);
  void add_sums(const Tensors& sums);

  Optimiser& optimiser_;
  const Sharing& sharing_;
  OrderedSum& gradients_;  // of the buffers that have any, one behind the other
  OrderedSum& sums_;
  struct Place {
    size_t begin = 0, count = 0;
  };
  std::map<size_t, Place> places_;  // of the buffers among gradients_
  size_t placed_ = 0;               // values
  std::vector<Told> round_;         // of the shares that the ranks add at a time, by rank
  std::vector<float> weights_;      // theirs
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

void SummedStep::hear(const Told& mine, size_t counts) {
  round_.clear();
  weights_.clear();
  for (const std::string& text : gathered(sharing_.ranks, packed(mine))) round_.push_back(unpacked(text));
  for (const Told& told : round_) note(told, counts);
}

/// A buffer that a share has a gradient of keeps its place until the step is taken.
void SummedStep::place_buffers() {
  const std::vector<Shape> shapes = optimiser_.buffer_shapes();
  for (size_t i = 0; i < shapes.size(); ++i) {
    if (!has_gradient(i) || places_.contains(i)) continue;
    places_[i] = {placed_, static_cast<size_t>(numel(shapes[i]))};
    placed_ += places_[i].count;
  }
  gradients_.grow(placed_);
}

std::span<float> SummedStep::values_of(size_t buffer) {
  const auto found = places_.find(buffer);
  return found == places_.end() ? std::span<float>()
                                : gradients_.values().subspan(found->second.begin, found->second.count);
}

void SummedStep::add_gradients(const Tensors& buffers) {
  place_buffers();
  for (const auto& [buffer, place] : places_) {
    if (buffers[buffer])
      read_over(buffers[buffer], values_of(buffer));
    else
      std::ranges::fill(values_of(buffer), 0.f);
  }
  gradients_.add(weights_);
}

void SummedStep::add_sums(const Tensors& sums) {
  size_t count = 0, at = 0;
  for (const Tensor& sum : sums) count += static_cast<size_t>(sum.numel());
  sums_.grow(count);
  for (const Tensor& sum : sums) {
    const auto size = static_cast<size_t>(sum.numel());
    read_over(sum, sums_.values().subspan(at, size));
    at += size;
  }
  sums_.add(std::vector<float>(weights_.size(), 1.f));
}

void SummedStep::add(const Step& step) {
  const Tensors buffers = optimiser_.buffers_of(step.gradients);
  hear(told_of(step, buffers), step.counts.size());
  add_gradients(buffers);
  add_sums(step.sums);
}

void SummedStep::take(Step& step) {
  gradients_.take();
  std::vector<std::span<const float>> buffers;
  for (size_t i = 0; i < optimiser_.buffer_shapes().size(); ++i) buffers.emplace_back(values_of(i));
  optimiser_.take_buffers(buffers, step.gradients);
  sums_.take();
  size_t at = 0;
  for (const Tensor& sum : step.sums) {
    assign({{sum, from_bytes(sums_.values().data() + at, DType::f32, sum.shape())}});
    at += static_cast<size_t>(sum.numel());
  }
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

TakenStep SharedSteps::take(Method& method, Optimiser& optimiser, const Progress& progress) {
  const auto update = [&](const Step& step) {
    optimiser.step(method.parameters(), step.gradients, method.groups(), progress);
  };
  if (sharing_.shares == 1) {
    const Step step = evaluated_step(method, optimiser, progress);
    update(step);
    TakenStep taken{static_cast<double>(step.loss.item())};
    for (const Figure& figure : step.figures) taken.figures[figure.name] = figure.value();
    return taken;
  }
  SummedStep sum(optimiser, sharing_, gradients_, sums_);
  Step step;
  for (int64_t first = 0; first < sharing_.shares; first += sharing_.ranks.size()) {
    Progress part = progress;
    part.share = {first + sharing_.ranks.rank(), sharing_.shares};
    step = evaluated_step(method, optimiser, part);
    sum.add(step);
  }
  sum.take(step);
  update(step);
  return sum.means();
}

}  // namespace cloam
