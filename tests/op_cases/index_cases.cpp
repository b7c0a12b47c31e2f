// Rows of gathers, scatters, sorting, segments and running sums.
#include "tests/op_cases/cases.h"
namespace cloam {
void add_index_cases(OpCases&) {}
void add_random_cases(OpCases&) {}
void add_dense_cases(OpCases&) {}
void add_field_cases(OpCases&) {}
}  // namespace cloam
