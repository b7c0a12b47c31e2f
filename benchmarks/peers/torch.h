// libtorch as a peer. A family is a function that adds its works; sizes come from the names.
#pragma once
#include <torch/torch.h>

#include "benchmarks/peers/peer.h"

void add_convolutions(peer::Works& all);  // torch_ops.cpp
void add_mlps(peer::Works& all);
void add_norms(peer::Works& all);
void add_attentions(peer::Works& all);
void add_streams(peer::Works& all);
void add_planes(peer::Works& all);
void add_networks(peer::Works& all);  // torch_networks.cpp: whole training steps

/// Leaves autograd off while a work without a gradient runs.
inline peer::Run without_gradient(const peer::Run& run) {
  return [run] {
    const torch::NoGradGuard off;
    run();
  };
}

/// "b8" -> 8, "4k" -> 4096, "1m" -> 1048576.
inline int64_t number(const std::string& word) {
  const std::string digits = word.substr(word.find_first_of("0123456789"));
  const int64_t unit = word.back() == 'm' ? 1 << 20 : word.back() == 'k' ? 1 << 10 : 1;
  return std::stoll(digits) * unit;
}
