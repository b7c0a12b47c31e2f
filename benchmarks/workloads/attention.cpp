// Workloads of the attention family.
#include "benchmarks/workload.h"

namespace cloam {

void add_attention_workloads(Workloads&) {}

}  // namespace cloam
