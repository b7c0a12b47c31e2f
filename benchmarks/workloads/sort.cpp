// Workloads of the sort family.
#include "benchmarks/workload.h"

namespace cloam {

void add_sort_workloads(Workloads&) {}

}  // namespace cloam
