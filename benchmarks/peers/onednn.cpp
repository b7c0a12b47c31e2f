// oneDNN as a peer: the products named matmul.SIZES.FORM, through its sgemm (row-major, as ours).
#include <dnnl.h>

#include <stdexcept>

#include "benchmarks/peers/product.h"

namespace {

std::string version() {
  const dnnl_version_t* v = dnnl_version();
  return std::to_string(v->major) + "." + std::to_string(v->minor) + "." + std::to_string(v->patch);
}

void multiply(const peer::Product& p, const float* a, const float* b, float* c) {
  const dnnl_status_t status = dnnl_sgemm(p.a_turned ? 'T' : 'N', p.b_turned ? 'T' : 'N', p.m, p.n, p.k, 1, a,
                                          p.a_turned ? p.m : p.k, b, p.b_turned ? p.k : p.n, 0, c, p.n);
  if (status != dnnl_success) throw std::runtime_error("dnnl_sgemm failed: " + std::to_string(status));
}

}  // namespace

int main() { return peer::serve("oneDNN " + version(), peer::products(multiply)); }
