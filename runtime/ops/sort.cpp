// Radix sort of keys with a payload.
#include <bit>
#include <cmath>

#include "runtime/debug.h"
#include "runtime/ops.h"
#include "runtime/ops/scan.h"
#include "runtime/ops/share.h"

namespace cloam {
namespace {

const Registered kSortKernels("sort");

/// keys [n] or [n,2], payload [n] or none -> uint32 [keys_begin(n) + n or 2 n]: the payload in the order of the keys'
/// lowest `bits` bits, and from keys_begin(n) on, where a cache line begins, the keys.
struct SortPairs final : Op {
  explicit SortPairs(int digits) : bits(digits) {}
  const char* name() const override { return "sort"; }
  void run(const Tensors& in, Tensor& out) const override;
  Tensors vjp(const Tensors&, const Tensor&, const Tensor&) const override { return {}; }
  int bits;
};

int64_t keys_begin(int64_t n) { return (n + 15) / 16 * 16; }

/// Chunks of keys that are counted and moved in order, by one work-item each.
struct Chunks {
  Chunks(const Variant& v, int64_t n) : length(std::max<int64_t>(v["LENGTH"], (n + v["CHUNKS"] - 1) / v["CHUNKS"])) {
    count = (n + length - 1) / length;
  }
  Range range() const { return range1(count, is_cpu_class() ? 1 : 64); }
  int64_t length, count;
};

/// KIND of kernels/sort.cl.
int kind_of(DType dtype) { return dtype == DType::u32 ? 0 : dtype == DType::i32 ? 1 : 2; }

void SortPairs::run(const Tensors& in, Tensor& out) const {
  const Variant& variant = choose("sort");
  const int64_t n = in[0].dim(0), begin = keys_begin(n);
  const int digit_bits = variant["BITS"], passes = (bits + digit_bits - 1) / digit_bits;
  const Chunks chunks(variant, n);
  const Tensor counts = empty({chunks.count << digit_bits}, DType::i32), bases = empty(counts.shape(), DType::i32);
  const Tensor pairs[] = {out, empty(out.shape(), DType::u32)};
  for (int pass = 0; pass < passes; pass++) {
    const bool first = pass == 0, last = pass == passes - 1, numbered = first && in.size() == 1;
    const Tensor &to = pairs[(passes - 1 - pass) % 2], &from = pairs[(passes - pass) % 2];  // the last pass fills `out`
    const Tensor &keys = first ? in[0] : from, &payload = first ? in.back() : from;
    const int64_t keys_at = first ? 0 : begin;
    const int shift = pass * digit_bits;
    Constants form = variant.constants;
    form.insert(form.end(),
                {{"WIDE", in[0].rank() == 2}, {"NUMBERED", numbered}, {"KIND", first ? kind_of(in[0].dtype()) : 0}});
    const uint32_t flip = last && in[0].dtype() == DType::i32 ? 0x80000000u : 0;
    launch(kernel("sort", "count_digits", form), "count_digits", chunks.range(), keys, counts, keys_at, n, chunks.count,
           chunks.length, shift);
    scan_rows(counts, bases, 1, {.exclusive = true});
    launch(kernel("sort", variant.kernel.c_str(), form), variant.kernel.c_str(), chunks.range(), keys, payload, bases,
           to, keys_at, begin, n, chunks.count, chunks.length, shift, flip);
  }
}

void check(const Tensor& keys, int bits, const Tensor& payload) {
  const bool wide = keys.rank() == 2 && keys.dim(1) == 2 && keys.dtype() == DType::u32;
  const int most = wide ? 64 : 32, least = keys.dtype() == DType::f32 ? 32 : 1;
  const bool known = keys.dtype() == DType::u32 || keys.dtype() == DType::i32 || keys.dtype() == DType::f32;
  if ((keys.rank() != 1 && !wide) || !known || bits < least || bits > most)
    throw Error(Fault::internal,
                text("[sort] keys ", to_string(keys.shape()), " ", name_of(keys.dtype()), " by ", bits,
                     " bits: want uint32 or int32 [n] by 1 to 32 bits, float32 [n] by 32 or uint32 [n,2] by 1 to 64"));
  if (payload && (keys.dtype() == DType::f32 || payload.rank() != 1 || payload.dim(0) != keys.dim(0) ||
                  payload.dtype() != DType::i32))
    throw Error(Fault::internal,
                text("[sort] payload ", to_string(payload.shape()), " ", name_of(payload.dtype()), " for keys ",
                     to_string(keys.shape()), " ", name_of(keys.dtype()), ": want int32 [n] for n keys of integers"));
}

/// The kernel reads the bits of 32-bit numbers: doubles (CLOAM_DEBUG=float64) go by the float nearest to them.
Tensor in_32_bits(const Tensor& keys) {
  if (keys.dtype() != DType::f32 || !debug().float64) return keys;
  std::vector<uint32_t> ordered;
  for (const float key : keys.to_host()) {
    const auto bits = std::bit_cast<uint32_t>(key);
    ordered.push_back(std::isnan(key) ? 0xffffffffu : bits ^ (bits >> 31 ? 0xffffffffu : 0x80000000u));
  }
  return from_host(ordered, keys.shape());
}

}  // namespace

Sorted sort(const Tensor& keys, int bits, const Tensor& payload) {
  if (bits == 0) bits = keys.rank() == 2 ? 64 : 32;
  check(keys, bits, payload);
  const int64_t n = keys.dim(0), begin = keys_begin(n);
  const Tensor pairs = make(std::make_shared<SortPairs>(bits), {begin + keys.numel()},
                            payload ? Tensors{in_32_bits(keys), payload} : Tensors{in_32_bits(keys)}, DType::u32);
  const Tensor order = bitcast(slice(pairs, 0, 0, n), DType::i32);
  // Keys that a gradient may reach are read again, in their order.
  if (keys.dtype() == DType::f32) return {gather_rows(keys, order), order};
  return {bitcast(reshape(slice(pairs, 0, begin, begin + keys.numel()), keys.shape()), keys.dtype()), order};
}

}  // namespace cloam
