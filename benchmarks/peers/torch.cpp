// libtorch as a peer.
#include "benchmarks/peers/torch.h"

#include <torch/version.h>

#include <thread>

int main() {
  torch::set_num_threads(static_cast<int>(std::thread::hardware_concurrency()));  // Debian's starts with one
  torch::manual_seed(0);
  peer::Works all;
  for (const auto add : {add_convolutions, add_mlps, add_norms, add_attentions, add_streams, add_planes, add_networks})
    add(all);
  return peer::serve("libtorch " TORCH_VERSION, std::move(all));
}
