// See method.h.
#include "models/train/method.h"

#include "runtime/error.h"

namespace cloam {

Gradients Method::gradients(const Progress& progress, const Tensors& wanted) {
  const Tensor value = loss(progress);
  return {value, grad_where_reached(value, wanted)};
}

void Method::adopt_networks(const TensorMap&) {
  throw Error(Fault::usage, text("--networks: ", name(), " has no networks that several scenes share"));
}

void Method::adopt_prior(const CodeDenoiser&) {
  throw Error(Fault::usage, text("--prior: ", name(), " has no codes of actors"));
}

}  // namespace cloam
