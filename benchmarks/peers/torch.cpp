// libtorch as a peer.
#include "benchmarks/peers/torch.h"

#include <thread>

int main() {
  torch::set_num_threads(static_cast<int>(std::thread::hardware_concurrency()));  // Debian's starts with one
  torch::manual_seed(0);
  peer::Works all;
  add_networks(all);
  return peer::serve(std::move(all));
}
