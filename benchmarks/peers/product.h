// The matrix products that libraries of linear algebra are timed on: C = A B in row-major, either operand perhaps
// stored transposed.
#pragma once
#include <memory>
#include <random>

#include "benchmarks/peers/peer.h"

namespace peer {

struct Product {
  int m = 0, n = 0, k = 0;
  bool a_turned = false, b_turned = false;
};

/// "matmul.64x16384x576.nn" (M x N x K) or "matmul.512.tn" (all three).
inline Product product_of(const std::string& name) {
  const auto parts = fields(name), sizes = fields(parts[1], 'x');
  const auto size = [&](std::size_t i) { return std::stoi(sizes[sizes.size() == 1 ? 0 : i]); };
  return {size(0), size(1), size(2), parts[2][0] == 't', parts[2][1] == 't'};
}

inline std::vector<float> random_values(std::size_t count, unsigned seed) {
  std::mt19937 engine(seed);
  std::normal_distribution<float> normal;
  std::vector<float> out(count);
  for (float& x : out) x = normal(engine);
  return out;
}

using Multiply = std::function<void(const Product& p, const float* a, const float* b, float* c)>;

inline std::vector<std::string> product_names() {
  std::vector<std::string> names = {"matmul.65536x64x64.nn", "matmul.65536x64x64.nt", "matmul.64x64x65536.tn",
                                    "matmul.64x16384x576.nn"};
  for (const char* size : {"512", "1024", "2048"})
    for (const char* form : {"nn", "nt", "tn"}) names.push_back(std::string("matmul.") + size + "." + form);
  return names;
}

inline Run prepare_product(const Product& p, const Multiply& multiply) {
  struct State {
    std::vector<float> a, b, c;
  };
  const auto count = [](int rows, int columns) { return static_cast<std::size_t>(rows) * columns; };
  const auto state = std::make_shared<State>();
  *state = {random_values(count(p.m, p.k), 1), random_values(count(p.k, p.n), 2), std::vector<float>(count(p.m, p.n))};
  return [=] { multiply(p, state->a.data(), state->b.data(), state->c.data()); };
}

inline Works products(const Multiply& multiply) {
  Works all;
  for (const std::string& name : product_names())
    all.push_back({name, [=] { return prepare_product(product_of(name), multiply); }});
  return all;
}

}  // namespace peer
