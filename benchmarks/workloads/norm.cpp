// Workloads of the norm family.
#include "benchmarks/workload.h"

namespace cloam {

void add_norm_workloads(Workloads&) {}

}  // namespace cloam
