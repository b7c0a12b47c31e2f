// Random tensors: Philox, one number for each place, whatever the device, its threads or its groups.
#include "runtime/ops/random.h"

#include "runtime/ops/share.h"

namespace cloam {
namespace {

const Registered kRandomKernels[] = {Registered("random_bits"), Registered("random_uniform"),
                                     Registered("random_normal"), Registered("random_below")};

enum class Draw { bits, uniform, normal, below };

struct Random final : Op {
  Random(Draw wanted, const RandomKey& with, uint64_t from, uint32_t end)
      : form(wanted), key_(with), first(from), limit(end) {}
  const char* name() const override {
    static const char* const names[] = {"random_bits", "random_uniform", "random_normal", "random_below"};
    return names[static_cast<size_t>(form)];
  }
  void run(const Tensors&, Tensor& out) const override {
    const auto low = [](uint64_t value) { return static_cast<uint32_t>(value); };
    const WorkShare work = share((out.numel() + 3) / 4, 1024);
    launch(kernel("random", "random", {{"FORM", static_cast<int>(form)}}), name(), work.range, out, out.numel(),
           low(key_.seed), low(key_.seed >> 32), low(first), low(first >> 32), key_.step, key_.stream, limit,
           work.chunk);
  }
  Tensors vjp(const Tensors&, const Tensor&, const Tensor&) const override { return {}; }
  Draw form;
  RandomKey key_;
  uint64_t first;
  uint32_t limit;
};

}  // namespace

Tensor random_bits(const Shape& shape, const RandomKey& key, uint64_t first_block) {
  return make(std::make_shared<Random>(Draw::bits, key, first_block, 0), shape, {}, DType::u32);
}

Tensor random_uniform(const Shape& shape, const RandomKey& key) {
  return make(std::make_shared<Random>(Draw::uniform, key, 0, 0), shape, {});
}

Tensor random_normal(const Shape& shape, const RandomKey& key) { return random_normal(shape, key, 0); }

Tensor random_normal(const Shape& shape, const RandomKey& key, uint64_t first_block) {
  return make(std::make_shared<Random>(Draw::normal, key, first_block, 0), shape, {});
}

Tensor random_below(const Shape& shape, int64_t n, const RandomKey& key) {
  if (n < 1 || n > int64_t{1} << 31)
    throw Error(Fault::internal, text("[random_below] a limit of ", n, ", want one from 1 to 2^31"));
  return make(std::make_shared<Random>(Draw::below, key, 0, static_cast<uint32_t>(n)), shape, {}, DType::i32);
}

}  // namespace cloam
