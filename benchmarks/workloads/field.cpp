// Workloads of the field family.
#include "benchmarks/workload.h"

namespace cloam {

void add_field_workloads(Workloads&) {}

}  // namespace cloam
