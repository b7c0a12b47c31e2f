// Values of a row's inputs, on the host and on the device in several layouts.
#pragma once
#include "tests/op_cases/op_cases.h"

namespace cloam {

/// Seeded numbers in [0, 1) (SplitMix64: the same on every platform).
class Numbers {
 public:
  explicit Numbers(const std::string& seed);
  double uniform();
  double normal();
  int64_t below(int64_t end) { return static_cast<int64_t>(uniform() * static_cast<double>(end)); }

 private:
  uint64_t state_;
};

inline bool is_float(DType dtype) { return dtype == DType::f32 || dtype == DType::f16; }

/// What the spec describes, rounded to its dtype.
HostArray host_input(const InputSpec& spec, const std::string& seed);

/// How an input lies in memory: packed; as the transposed view of a transposed copy; as every second element of a
/// larger tensor with NaN (or -7) between.
enum class Lie { dense, transposed, sliced };
const char* name_of(Lie lie);
Tensor on_device(const HostArray& values, const InputSpec& spec, Lie lie);

/// Any tensor's values.
HostArray host_output(const Tensor& tensor);

}  // namespace cloam
