// Workloads of the stream family.
#include "benchmarks/workload.h"

namespace cloam {

void add_stream_workloads(Workloads&) {}

}  // namespace cloam
