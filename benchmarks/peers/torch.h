// libtorch as a peer. A family is a function that adds its works; autograd is on unless a work turns it off.
#pragma once
#include <torch/torch.h>

#include "benchmarks/peers/peer.h"

void add_networks(peer::Works& all);  // torch_networks.cpp: whole training steps
