// A workload: something worth timing, by a name that reports and peers share. Families list theirs in workloads/ (ops,
// runtime alone) and steps/ (whole training steps, which need models/).
#pragma once
#include <functional>
#include <string>
#include <vector>

namespace cloam {

using Run = std::function<void()>;

struct Workload {
  std::string name;                // "matmul.512.nn": family, sizes, what of it
  double flops = 0, bytes = 0;     // of one run: what the mathematics needs, not what the kernels do
  std::function<Run()> prepare;    // makes the inputs on the device, gives what to time: launches, does not wait
  std::vector<std::string> peers;  // programs of benchmarks/peers that know this name
};
using Workloads = std::vector<Workload>;

void add_matmul_workloads(Workloads& all);
void add_conv_workloads(Workloads& all);
void add_mlp_workloads(Workloads& all);
void add_norm_workloads(Workloads& all);
void add_attention_workloads(Workloads& all);
void add_stream_workloads(Workloads& all);  // Adam, bias + ReLU, many small ops
void add_field_workloads(Workloads& all);   // tri-planes, hash grid
void add_sort_workloads(Workloads& all);
void add_splat_workloads(Workloads& all);
void add_ssim_workloads(Workloads& all);
void add_volume_workloads(Workloads& all);  // marching, compositing, occupancy
void add_row_workloads(Workloads& all);     // op rows that name a benchmark size

/// Every workload that the runtime alone can run.
Workloads op_workloads();
/// Whole training steps (benchmarks/steps, linked by the program only).
Workloads step_workloads();

}  // namespace cloam
