// The families, in the order of the report.
#include "benchmarks/workload.h"

namespace cloam {

Workloads op_workloads() {
  Workloads all;
  add_matmul_workloads(all);
  add_conv_workloads(all);
  add_mlp_workloads(all);
  add_norm_workloads(all);
  add_attention_workloads(all);
  add_stream_workloads(all);
  add_field_workloads(all);
  add_sort_workloads(all);
  add_splat_workloads(all);
  add_ssim_workloads(all);
  add_volume_workloads(all);
  add_row_workloads(all);
  return all;
}

}  // namespace cloam
