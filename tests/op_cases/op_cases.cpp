// The list of all rows.
#include "tests/op_cases/op_cases.h"

#include "tests/op_cases/cases.h"

namespace cloam {

const std::vector<OpCase>& op_cases() {
  static const std::vector<OpCase> rows = [] {
    std::vector<OpCase> out;
    for (auto add : {add_pointwise_cases, add_integer_cases, add_view_cases, add_reduce_cases, add_join_cases,
                     add_index_cases, add_random_cases, add_dense_cases, add_conv_cases, add_norm_cases,
                     add_field_cases, add_splat_cases, add_placing_cases, add_ssim_cases, add_composite_cases})
      add(out);
    return out;
  }();
  return rows;
}

}  // namespace cloam
