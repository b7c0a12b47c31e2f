// Sorting, running sums and sums over segments: work whose order the data decides.
#include "benchmarks/workload.h"
#include "runtime/ops.h"

namespace cloam {
namespace {

constexpr int64_t kMillionKeys = 1 << 20;

/// Keys of 64 or 32 random bits with a payload of 32.
Run prepare_sort(int64_t n, int words) {
  const Tensor keys = random_bits(words == 2 ? Shape{n, 2} : Shape{n}, {1});
  const Tensor payload = bitcast(random_bits({n}, {2}), DType::i32);
  eval({keys, payload});
  return [=] {
    const Sorted sorted = sort(keys, 0, payload);
    eval({sorted.keys, sorted.order});
  };
}

Run prepare_scan(int64_t n) {
  const Tensor x = random_uniform({n}, {1});
  eval({x});
  return [=] { eval({cumsum(x, 0)}); };
}

/// Segments of 8 rows on average, of any length from none.
Run prepare_segment_sum(int64_t n, int64_t width) {
  const int64_t segments = n / 8;
  const Tensor x = random_uniform({n, width}, {1});
  const Tensor ids = sort(random_below({n}, segments, {2})).keys, offsets = segment_offsets(ids, segments);
  eval({x, offsets});
  return [=] { eval({segment_sum(x, offsets)}); };
}

}  // namespace

void add_sort_workloads(Workloads& all) {
  all.push_back(
      {"sort.4m.u64", 0, 24.0 * 4 * kMillionKeys, [] { return prepare_sort(4 * kMillionKeys, 2); }, {"host"}});
  all.push_back(
      {"sort.4m.u32", 0, 16.0 * 4 * kMillionKeys, [] { return prepare_sort(4 * kMillionKeys, 1); }, {"host"}});
  all.push_back({"scan.16m", 0, 8.0 * 16 * kMillionKeys, [] { return prepare_scan(16 * kMillionKeys); }, {"host"}});
  for (int64_t width : {1, 4, 16}) {
    const double bytes =
        4.0 * 4 * kMillionKeys * (1 + 1.0 / 8) + 4.0 * 4 * kMillionKeys / static_cast<double>(8 * width);
    all.push_back({"segment_sum.4m.x" + std::to_string(width),
                   0,
                   bytes,
                   [=] { return prepare_segment_sum(4 * kMillionKeys / width, width); },
                   {}});
  }
}

}  // namespace cloam
