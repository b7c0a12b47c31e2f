// OpenBLAS as a peer: the products named matmul.SIZES.FORM.
#include <cblas.h>

#include "benchmarks/peers/product.h"

namespace {

CBLAS_TRANSPOSE form(bool turned) { return turned ? CblasTrans : CblasNoTrans; }

void multiply(const peer::Product& p, const float* a, const float* b, float* c) {
  cblas_sgemm(CblasRowMajor, form(p.a_turned), form(p.b_turned), p.m, p.n, p.k, 1, a, p.a_turned ? p.m : p.k, b,
              p.b_turned ? p.k : p.n, 0, c, p.n);
}

}  // namespace

int main() { return peer::serve(openblas_get_config(), peer::products(multiply)); }
