// Whole training steps, in the order of the report.
#include "benchmarks/workload.h"

namespace cloam {

void add_nerf_steps(Workloads& all);
void add_network_steps(Workloads& all);
void add_splat_steps(Workloads& all);

Workloads step_workloads() {
  Workloads all;
  add_nerf_steps(all);
  add_network_steps(all);
  add_splat_steps(all);
  return all;
}

}  // namespace cloam
