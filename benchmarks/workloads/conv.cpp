// Workloads of the conv family.
#include "benchmarks/workload.h"

namespace cloam {

void add_conv_workloads(Workloads&) {}

}  // namespace cloam
