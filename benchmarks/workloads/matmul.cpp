// Matrix products: square ones in three forms, and the long thin ones of networks over many samples.
#include "benchmarks/workload.h"
#include "runtime/error.h"
#include "runtime/ops.h"

namespace cloam {
namespace {

struct Product {
  int64_t m, n, k;
  const char* form;  // nn: A B; nt: A Bᵀ; tn: Aᵀ B
};

Run prepare(const Product& p) {
  const bool a_turned = p.form[0] == 't', b_turned = p.form[1] == 't';
  const Tensor a = random_normal(a_turned ? Shape{p.k, p.m} : Shape{p.m, p.k}, {1});
  const Tensor b = random_normal(b_turned ? Shape{p.n, p.k} : Shape{p.k, p.n}, {2});
  eval({a, b});
  return [=] { eval({matmul(a_turned ? transpose(a) : a, b_turned ? transpose(b) : b)}); };
}

void add(Workloads& all, const std::string& sizes, const Product& p) {
  const double flops = 2.0 * static_cast<double>(p.m) * static_cast<double>(p.n) * static_cast<double>(p.k);
  all.push_back({text("matmul.", sizes, ".", p.form), flops, 0, [p] { return prepare(p); }, {"openblas", "onednn"}});
}

}  // namespace

void add_matmul_workloads(Workloads& all) {
  for (int64_t n : {512, 1024, 2048})
    for (const char* form : {"nn", "nt", "tn"}) add(all, std::to_string(n), {n, n, n, form});
  for (const char* form : {"nn", "nt"}) add(all, "65536x64x64", {65536, 64, 64, form});
  add(all, "64x64x65536", {64, 64, 65536, "tn"});
  add(all, "64x16384x576", {64, 16384, 576, "nn"});
}

}  // namespace cloam
