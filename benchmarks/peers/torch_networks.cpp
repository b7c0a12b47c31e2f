// Whole training steps of networks, as the same graph in libtorch.
#include "benchmarks/peers/torch.h"

void add_networks(peer::Works&) {}
