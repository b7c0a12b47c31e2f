// OpenBLAS as a peer: the products named matmul.SIZES.FORM.
#include <cblas.h>

#include "benchmarks/peers/product.h"

int main() {
  return peer::serve(peer::products([](const peer::Product& p, const float* a, const float* b, float* c) {
    const auto turned = [](bool yes) { return yes ? CblasTrans : CblasNoTrans; };
    cblas_sgemm(CblasRowMajor, turned(p.a_turned), turned(p.b_turned), p.m, p.n, p.k, 1, a, p.a_turned ? p.m : p.k, b,
                p.b_turned ? p.k : p.n, 0, c, p.n);
  }));
}
