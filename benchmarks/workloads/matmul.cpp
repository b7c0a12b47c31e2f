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
  all.push_back(
      {text("matmul.", sizes, ".", p.form), flops, 0, [p] { return prepare(p); }, {"openblas", "onednn", "clblast"}});
}

struct Batch {
  int64_t count, m, n, k;
};

/// Heads of attention: [count,m,k] x [count,k,n], the second a turned view as in q k^T.
Run prepare_batch(const Batch& p) {
  const Tensor a = random_normal({p.count, p.m, p.k}, {1}), b = random_normal({p.count, p.n, p.k}, {2});
  eval({a, b});
  return [=] { eval({matmul(a, transpose(b))}); };
}

/// A layer with its bias and ReLU: [s,k] x [k,n].
Run prepare_linear(int64_t s, int64_t n, int64_t k) {
  const Tensor x = random_normal({s, k}, {1}), w = random_normal({k, n}, {2}), bias = random_normal({n}, {3});
  eval({x, w, bias});
  return [=] { eval({linear(x, w, {.bias = bias, .activation = Activation::relu})}); };
}

}  // namespace

void add_matmul_workloads(Workloads& all) {
  for (int64_t n : {512, 1024, 2048})
    for (const char* form : {"nn", "nt", "tn"}) add(all, std::to_string(n), {n, n, n, form});
  for (const char* form : {"nn", "nt"}) add(all, "65536x64x64", {65536, 64, 64, form});
  add(all, "64x64x65536", {64, 64, 65536, "tn"});
  add(all, "64x16384x576", {64, 16384, 576, "nn"});
  add(all, "256x1024x4096", {256, 1024, 4096, "nn"});
  for (const char* form : {"nn", "nt"}) add(all, "32768x256x256", {32768, 256, 256, form});
  add(all, "256x256x32768", {256, 256, 32768, "tn"});
  const Batch heads = {32, 256, 256, 64};
  all.push_back(
      {"matmul.32x256x256x64.nt", 2.0 * 32 * 256 * 256 * 64, 0, [heads] { return prepare_batch(heads); }, {}});
  all.push_back(
      {"linear.32768x256x256.relu", 2.0 * 32768 * 256 * 256, 0, [] { return prepare_linear(32768, 256, 256); }, {}});
}

}  // namespace cloam
