// Workloads of the mlp family.
#include "benchmarks/workload.h"

namespace cloam {

void add_mlp_workloads(Workloads&) {}

}  // namespace cloam
