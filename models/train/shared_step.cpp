// See shared_step.h.
#include "models/train/shared_step.h"

#include <algorithm>
#include <cstring>
#include <sstream>

#include "runtime/debug.h"
#include "runtime/device.h"
#include "runtime/error.h"
#include "runtime/op.h"

namespace cloam {
namespace {

/// What ranks tell each other of a share beside its floats.
struct Told {
  std::vector<double> numbers = {};       // weight, loss, whether each buffer has a gradient, counts, figures
  std::vector<std::string> figures = {};  // their names
  std::string failure = {};               // in words: what it reads is damaged
};

std::string packed(const Told& told) {
  std::string out(reinterpret_cast<const char*>(told.numbers.data()), told.numbers.size() * sizeof(double));
  std::string names;
  for (const std::string& name : told.figures) names += name + '\n';
  return text(out.size(), '\n', names.size(), '\n') + out + names + told.failure;
}

Told unpacked(const std::string& words) {
  std::istringstream in(words);
  size_t bytes = 0, names = 0;
  in >> bytes >> names;
  in.get();
  Told told;
  told.numbers.resize(bytes / sizeof(double));
  in.read(reinterpret_cast<char*>(told.numbers.data()), static_cast<std::streamsize>(bytes));
  std::string lines(names, '\0');
  in.read(lines.data(), static_cast<std::streamsize>(names));
  told.failure.assign(std::istreambuf_iterator<char>(in), {});
  std::istringstream all(lines);
  for (std::string name; std::getline(all, name);) told.figures.push_back(name);
  return told;
}

using OrderedSums = std::vector<OrderedSum>;

/// One step's sums over shares.
class SummedStep {
 public:
  SummedStep(const Sharing& sharing, OrderedSums& gradients, OrderedSum& sums)
      : sharing_(sharing), gradients_(gradients), sums_(sums) {}
  /// An evaluated share of this rank, while every other rank adds one, too. Of the last, `buffers` (its gradients) then
  /// hold the sum of all in this rank's rows; an empty handle where no share has a gradient.
  void add(const Step& step, Tensors& buffers, const Optimiser& optimiser);
  /// In place of a share, where none could be made. Does not return.
  void fail(const Error& error);
  /// What else a step leaves behind, into the last share's step, on all ranks.
  void take(const Step& step) const;
  TakenStep means() const;

 private:
  Told told_of(const Step& step, const Tensors& buffers) const;
  void hear(const Told& mine, size_t counts);
  void note_gradients(size_t buffers);
  void note(const Told& told, size_t counts);
  void add_gradients(Tensors& buffers, const Optimiser& optimiser);
  void add_last(const Tensor& buffer, OrderedSum& sum) const;
  Tensor add_in_common(const StepMemory& common, size_t buffer, const Shape& shape);
  void add_sums(const Tensors& sums);

  const Sharing& sharing_;
  OrderedSums& gradients_;  // by buffer
  OrderedSum& sums_;
  std::vector<bool> has_gradient_;  // of any share, by buffer
  int64_t added_ = 0;               // shares
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

void SummedStep::note_gradients(size_t buffers) {
  has_gradient_.resize(buffers);
  for (const Told& told : round_)
    for (size_t i = 0; i < buffers; ++i) has_gradient_[i] = has_gradient_[i] || told.numbers[kBeforeBuffers + i] > 0;
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
  for (const std::string& words : gathered(sharing_.ranks, packed(mine))) round_.push_back(unpacked(words));
  for (const Told& told : round_)
    if (!told.failure.empty()) throw Error(Fault::data, told.failure);
  for (const Told& told : round_) note(told, counts);
}

void SummedStep::fail(const Error& error) { hear({{}, {}, error.what()}, 0); }

/// In place: the sum's own rows lie where the share's did, and nothing is copied.
void SummedStep::add_last(const Tensor& buffer, OrderedSum& sum) const {
  const auto floats = [](auto bytes) {
    return std::span(reinterpret_cast<const float*>(bytes.data()), bytes.size() / sizeof(float));
  };
  const Share own{sharing_.ranks.rank(), sharing_.ranks.size()};
  const int64_t count = buffer.dim(0), begin = own.begin(count), end = own.end(count);
  read_rows_on_host(buffer, 0, begin, [&](std::span<const std::byte> before) {
    read_rows_on_host(buffer, end, count, [&](std::span<const std::byte> behind) {
      change_rows_on_host(buffer, begin, end, [&](std::span<std::byte> mine) {
        const std::span place(reinterpret_cast<float*>(mine.data()), mine.size() / sizeof(float));
        sum.add_last({floats(before), place, floats(behind)}, place, count, weights_);
      });
    });
  });
}

/// The same where this rank sees the others' shares. Where one has no gradient, its memory holds anything.
Tensor SummedStep::add_in_common(const StepMemory& common, size_t buffer, const Shape& shape) {
  std::vector<std::span<const float>> shares;
  std::vector<float> weights;
  for (size_t rank = 0; rank < round_.size(); ++rank) {
    if (round_[rank].numbers[kBeforeBuffers + buffer] == 0) continue;
    shares.push_back(common.rows_of_ranks[rank]);
    weights.push_back(weights_[rank]);
  }
  const bool is_whole = shape == common.gradients.all.shape();
  const Tensor& all = is_whole ? common.gradients.all : common.gradients.parts.front();
  const Share own{sharing_.ranks.rank(), sharing_.ranks.size()};
  change_rows_on_host(all, own.begin(all.dim(0)), own.end(all.dim(0)), [&](std::span<std::byte> mine) {
    const std::span sum(reinterpret_cast<float*>(mine.data()), mine.size() / sizeof(float));
    gradients_[buffer].add_last(shares, sum, weights);
  });
  return all;
}

/// Where only other shares have a gradient, this one adds zeros.
void SummedStep::add_gradients(Tensors& buffers, const Optimiser& optimiser) {
  const bool last = added_ == sharing_.shares;
  const std::vector<Shape> shapes = optimiser.buffer_shapes();
  for (size_t i = 0; i < buffers.size(); ++i) {
    if (!has_gradient_[i]) continue;
    const StepMemory* const common = last ? optimiser.in_common(i) : nullptr;
    if (common) {
      buffers[i] = add_in_common(*common, i, shapes[i]);
      continue;
    }
    if (!buffers[i]) buffers[i] = from_host(std::vector<float>(static_cast<size_t>(numel(shapes[i])), 0.f), shapes[i]);
    if (last)
      add_last(buffers[i], gradients_[i]);
    else
      read_on_host(buffers[i],
                   [&](std::span<const float> values) { gradients_[i].add(values, shapes[i][0], weights_); });
  }
}

void SummedStep::add_sums(const Tensors& sums) {
  std::vector<float> all;
  for (const Tensor& sum : sums)
    read_on_host(sum, [&](std::span<const float> values) { all.insert(all.end(), values.begin(), values.end()); });
  if (all.empty()) return;
  sums_.add(all, static_cast<int64_t>(all.size()), std::vector<float>(weights_.size(), 1.f));
}

/// As many as there are, all of nothing.
void begin_sums(OrderedSums& sums, size_t count, const Ranks& ranks) {
  while (sums.size() < count) sums.emplace_back(ranks);
  sums.erase(sums.begin() + static_cast<std::ptrdiff_t>(count), sums.end());
  for (OrderedSum& sum : sums) sum.begin();
}

void SummedStep::add(const Step& step, Tensors& buffers, const Optimiser& optimiser) {
  if (weight_ == 0) {
    begin_sums(gradients_, buffers.size(), sharing_.ranks);
    sums_.begin();
  }
  synchronize();  // who hears of this share may read its gradients
  hear(told_of(step, buffers), step.counts.size());
  note_gradients(buffers.size());
  added_ += sharing_.ranks.size();
  add_gradients(buffers, optimiser);
  add_sums(step.sums);
}

void SummedStep::take(const Step& step) const {
  size_t count = 0;
  for (const Tensor& sum : step.sums) count += static_cast<size_t>(sum.numel());
  std::vector<float> all(count);
  if (count > 0) sums_.spread(all);
  const float* at = all.data();
  for (const Tensor& sum : step.sums) {
    assign({{sum, from_bytes(at, DType::f32, sum.shape())}});
    at += sum.numel();
  }
  for (size_t i = 0; i < counts_.size(); ++i) *step.counts[i] = counts_[i];
}

TakenStep SummedStep::means() const {
  TakenStep taken{loss_ / weight_};
  for (const auto& [name, mean] : figures_) taken.figures[name] = mean.sum / mean.weight;
  return taken;
}

/// Every rank's own rows to all. Of pretended ranks none come.
void spread_rows_of(const Tensor& tensor, const Ranks& ranks) {
  const int64_t count = tensor.dim(0);
  const Share own{ranks.rank(), ranks.size()};
  if (own.ranks == 1) return;
  read_rows_on_host(tensor, own.begin(count), own.end(count), [&](std::span<const std::byte> mine) {
    if (!ranks.real()) {
      const size_t row = static_cast<size_t>(tensor.numel() / std::max<int64_t>(1, count)) * size_of(tensor.dtype());
      std::vector<std::byte> others(static_cast<size_t>(count) * row - mine.size());
      return spread_rows(ranks, {mine, {}, others}, count);
    }
    overwrite_rows_on_host(tensor, 0, own.begin(count), [&](std::span<std::byte> before) {
      overwrite_rows_on_host(tensor, own.end(count), count, [&](std::span<std::byte> behind) {
        spread_rows(ranks, {mine, before, behind}, count);
      });
    });
  });
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

SharedSteps::SharedSteps(const Sharing& sharing) : sharing_(sharing), sums_(sharing.ranks) {
  if (sharing.shares > 1 && debug().float64)
    throw Error(Fault::usage, text("CLOAM_DEBUG=float64 takes one device and one share of a batch a step; found ",
                                   sharing.shares, " shares\n  fix: train without mpirun and --gradient-accumulation"));
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
  SummedStep sum(sharing_, gradients_, sums_);
  if (optimiser.has_common()) meet(sharing_.ranks);  // nobody reads what a method's replacements are made of any more
  optimiser.gather(method.parameters());
  Step step;
  Tensors gradients;
  for (int64_t first = 0; first < sharing_.shares; first += sharing_.ranks.size()) {
    Progress part = progress;
    part.share = {first + sharing_.ranks.rank(), sharing_.shares};
    try {
      step = evaluated_step(method, optimiser, part);
    } catch (const Error& error) {
      if (error.fault() != Fault::data) throw;
      sum.fail(error);
    }
    gradients = optimiser.buffers_of(step.gradients);
    sum.add(step, gradients, optimiser);
  }
  sum.take(step);
  Progress own = progress;
  own.share = {sharing_.ranks.rank(), sharing_.ranks.size()};
  optimiser.step_rows(method.parameters(), gradients, {method.groups(), own});
  const Tensors stepped = optimiser.stepped(method.parameters());
  for (size_t i = 0; i < stepped.size(); ++i)
    if (gradients[i] && stepped[i]) spread_rows_of(stepped[i], sharing_.ranks);
  if (optimiser.has_common()) {
    synchronize();  // what others see of this rank's step is there
    meet(sharing_.ranks);
  }
  moments_apart_ = sharing_.ranks.size() > 1;
  return sum.means();
}

void SharedSteps::gather_moments(Optimiser& optimiser) {
  if (!moments_apart_) return;
  for (const Tensor& moments : optimiser.moments()) spread_rows_of(moments, sharing_.ranks);
  moments_apart_ = false;
}

}  // namespace cloam
