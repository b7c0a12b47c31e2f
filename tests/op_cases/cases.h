// The families of op rows; each adds its rows to the list in op_cases.cpp.
#pragma once
#include "tests/op_cases/op_cases.h"

namespace cloam {

using OpCases = std::vector<OpCase>;
void add_pointwise_cases(OpCases& rows);
void add_integer_cases(OpCases& rows);
void add_view_cases(OpCases& rows);
void add_reduce_cases(OpCases& rows);
void add_join_cases(OpCases& rows);
void add_index_cases(OpCases& rows);
void add_random_cases(OpCases& rows);
void add_dense_cases(OpCases& rows);
void add_conv_cases(OpCases& rows);
void add_norm_cases(OpCases& rows);
void add_field_cases(OpCases& rows);
void add_splat_cases(OpCases& rows);
void add_placing_cases(OpCases& rows);
void add_ssim_cases(OpCases& rows);
void add_composite_cases(OpCases& rows);

}  // namespace cloam
