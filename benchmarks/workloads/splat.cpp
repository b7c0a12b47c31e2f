// Workloads of the splat family.
#include "benchmarks/workload.h"

namespace cloam {

void add_splat_workloads(Workloads&) {}

}  // namespace cloam
