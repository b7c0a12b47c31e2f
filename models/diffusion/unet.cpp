// The U-Net.
#include "models/diffusion/unet.h"

#include <cmath>

#include "runtime/error.h"
#include "runtime/ops.h"

namespace cloam {
namespace {

const float kUnitVariance = std::sqrt(3.f);  // uniform in +- this has variance 1

std::string numbered(const char* name, size_t i) { return name + std::to_string(i); }

}  // namespace

Unet::Unet(const Scope& scope, const UnetOptions& o)
    : options_(o),
      embedding_(4 * o.base),
      time1_(scope / "time1", o.base, embedding_),
      time2_(scope / "time2", embedding_, embedding_),
      enter_(scope / "enter", {o.channels + o.image_channels, o.base}),
      last_norm_(scope / "last_norm", o.base * o.multipliers.front(), o.groups),
      leave_(scope / "leave", {o.base * o.multipliers.front(), o.channels, 3, 1, 0.f, o.half}) {
  for (const Label& label : o.labels)
    label_tables_.push_back(scope.uniform(label.name, {label.count + 1, embedding_}, kUnitVariance));
  std::vector<int64_t> kept = {o.base};
  const int64_t width = build_down(scope, kept);
  const ResBlockShape middle = {width, width, o.groups, embedding_, true, false, o.half};
  middle1_.emplace(scope / "middle.block0", middle);
  attention_.emplace(scope / "middle.attention", AttentionShape{width, o.groups, true});
  if (o.context_width > 0)
    cross_attention_.emplace(scope / "middle.cross_attention", CrossAttentionShape{width, o.context_width, o.groups});
  middle2_.emplace(scope / "middle.block1", middle);
  build_up(scope, width, kept);
}

/// Collects in `kept` the widths of what the way up will join again; returns the width at the bottom.
int64_t Unet::build_down(const Scope& scope, std::vector<int64_t>& kept) {
  int64_t width = options_.base;
  for (size_t level = 0; level < options_.multipliers.size(); level++) {
    const Scope here = scope / numbered("down", level);
    Down& down = down_.emplace_back();
    for (int i = 0; i < options_.blocks; i++) {
      const int64_t out = options_.base * options_.multipliers[level];
      down.blocks.emplace_back(here / numbered("block", static_cast<size_t>(i)),
                               ResBlockShape{width, out, options_.groups, embedding_, true, false, options_.half});
      kept.push_back(width = out);
    }
    if (level + 1 == options_.multipliers.size()) continue;
    down.halve.emplace(here / "halve", ConvShape{width, width, 3, 2});
    kept.push_back(width);
  }
  return width;
}

/// One block more a level than on the way down: the image that entered a level is joined too.
void Unet::build_up(const Scope& scope, int64_t width, std::vector<int64_t>& kept) {
  for (size_t level = options_.multipliers.size(); level-- > 0;) {
    const Scope here = scope / numbered("up", level);
    Up& up = up_.emplace_back();
    for (int i = 0; i <= options_.blocks; i++) {
      const int64_t out = options_.base * options_.multipliers[level];
      up.blocks.emplace_back(
          here / numbered("block", static_cast<size_t>(i)),
          ResBlockShape{width + kept.back(), out, options_.groups, embedding_, true, false, options_.half});
      kept.pop_back();
      width = out;
    }
    if (level > 0) up.after_doubling.emplace(here / "after_doubling", ConvShape{width, width});
  }
}

/// What every residual block projects: silu of time and labels together, [N, embedding].
Tensor Unet::embed(const Tensor& t, const Condition& condition) const {
  Tensor sum = time2_(silu(time1_(timestep_encoding(t, options_.base))));
  for (size_t i = 0; i < label_tables_.size(); i++) sum = sum + gather_rows(label_tables_[i], condition.labels[i]);
  return silu(sum);
}

void Unet::check(const Tensor& noisy, const Condition& condition) const {
  const int64_t step = int64_t{1} << (down_.size() - 1);
  if (noisy.rank() != 4 || noisy.dim(1) != options_.channels || noisy.dim(2) % step != 0 || noisy.dim(3) % step != 0)
    throw Error(Fault::internal, text("[unet] noisy is ", to_string(noisy.shape()), ", want [N, ", options_.channels,
                                      ", H, W] with H and W multiples of ", step));
  if (condition.labels.size() != label_tables_.size())
    throw Error(Fault::internal,
                text("[unet] the condition has ", condition.labels.size(), " labels, want ", label_tables_.size()));
  const auto fits = [](const Tensor& part, int axis, int64_t want) {
    return part ? part.dim(axis) == want : want == 0;
  };
  if (!fits(condition.image, 1, options_.image_channels) || !fits(condition.context, -1, options_.context_width))
    throw Error(Fault::internal, text("[unet] want a condition with an image of ", options_.image_channels,
                                      " channels and tokens of ", options_.context_width, " numbers (0: none)"));
}

Tensor Unet::operator()(const Tensor& noisy, const Tensor& t, const Condition& condition) const {
  check(noisy, condition);
  const Tensor embedded = embed(t, condition);
  Tensor h = enter_(condition.image ? concat({noisy, condition.image}, 1) : noisy);
  Tensors kept = {h};
  for (const Down& level : down_) {
    for (const ResBlock& block : level.blocks) kept.push_back(h = block(h, embedded));
    if (level.halve) kept.push_back(h = (*level.halve)(h));
  }
  h = (*attention_)((*middle1_)(h, embedded));
  if (cross_attention_) h = (*cross_attention_)(h, condition.context);
  h = (*middle2_)(h, embedded);
  for (const Up& level : up_) {
    for (const ResBlock& block : level.blocks) {
      h = block(concat({h, kept.back()}, 1), embedded);
      kept.pop_back();
    }
    if (level.after_doubling) h = level.after_doubling->on_doubled(h);
  }
  return leave_(last_norm_.then_silu(h));
}

}  // namespace cloam
