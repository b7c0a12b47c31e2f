// Whole training steps of the paper's networks: forward, backward, Adam over all parameters.
#include <memory>

#include "benchmarks/workload.h"
#include "models/diffusion/noise_schedule.h"
#include "models/diffusion/unet.h"
#include "models/fields/asset_decoder.h"
#include "models/train/optimiser.h"
#include "runtime/ops.h"

namespace cloam {
namespace {

const ParameterGroups kGroups = {{"", 1e-4f}};

/// Parameters, and what a step minimises.
struct Network {
  Params params;
  std::function<Tensor()> loss;
  std::unique_ptr<Optimiser> optimiser;
  int64_t steps = 0;
};

void step(Network& network) {
  Tensors all;
  for (const auto& [name, p] : network.params) all.push_back(p);
  const Tensor loss = network.loss();
  all = grad(loss, all);
  network.optimiser->expect(all);
  all.push_back(loss);
  eval(all);
  all.pop_back();
  network.optimiser->step(network.params, all, kGroups, {++network.steps});
}

Run stepping(const std::shared_ptr<Network>& network) {
  network->optimiser = std::make_unique<Optimiser>(network->params, kGroups);
  return [network] { step(*network); };
}

Tensor numbers(int64_t n, int64_t below) {
  const Tensor ids = random_below({n}, below, {3});
  eval({ids});
  return ids;
}

Tensor values(const Shape& shape, uint64_t seed) {
  const Tensor x = random_normal(shape, {seed});
  eval({x});
  return x;
}

Run prepare_unet(int64_t batch) {
  auto network = std::make_shared<Network>();
  const auto unet = std::make_shared<Unet>(Scope{network->params, "unet", 1});
  const Shape shape = {batch, 32, 8, 8};
  const Tensor x = values(shape, 1), noise = values(shape, 2), t = numbers(batch, 1000);
  const Condition condition = {{numbers(batch, 8), numbers(batch, 2)}};
  network->loss = [=, schedule = NoiseSchedule()] {
    const Tensor v = (*unet)(schedule.noisy(x, noise, t), cast(t, DType::f32), condition);
    return mean(square(v - schedule.target(Prediction::velocity, x, noise, t)));
  };
  return stepping(network);
}

Run prepare_decoder(int64_t batch) {
  auto network = std::make_shared<Network>();
  const auto decoder = std::make_shared<AssetDecoder>(Scope{network->params, "decoder", 1});
  const Tensor latent = parameter(values({batch, 32, 8, 8}, 1).to_host(), {batch, 32, 8, 8});
  const Tensor planes = values({batch, 36, 128, 128}, 2), class_id = numbers(batch, 8);
  network->params["latent"] = latent;
  network->loss = [=] { return mean(square((*decoder)(latent, class_id) - planes)); };
  return stepping(network);
}

/// Multiply-adds of a residual block's convolutions at so many places.
double residual(double in, double out, double places) {
  return places * (9 * in * out + 9 * out * out + (in == out ? 0 : in * out));
}

double attention(double channels, double places) { return places * (4 * channels * channels + 2 * places * channels); }

/// Multiply-adds of an image through the paper's U-Net; those of time and conditions (0.02 G) are left out.
double unet_multiply_adds() {
  const double base = 128, widths[] = {base, 2 * base, 4 * base}, places[] = {64, 16, 4};
  double total = 2 * 9 * 32 * base * places[0], width = base;
  std::vector<double> kept = {base};
  for (int level = 0; level < 3; level++) {
    for (int i = 0; i < 2; i++) {
      total += residual(width, widths[level], places[level]);
      kept.push_back(width = widths[level]);
    }
    if (level == 2) continue;
    total += 9 * width * width * places[level + 1];
    kept.push_back(width);
  }
  total += 2 * residual(width, width, places[2]) + attention(width, places[2]);
  for (int level = 2; level >= 0; level--) {
    for (int i = 0; i < 3; i++) {
      total += residual(width + kept.back(), widths[level], places[level]);
      width = widths[level];
      kept.pop_back();
    }
    if (level > 0) total += 9 * width * width * places[level - 1];
  }
  return total;
}

/// Of an asset: 2.7 G, as written, with the images doubled before they are convolved.
double decoder_multiply_adds() {
  const double widths[] = {256, 128, 128, 64, 64};
  double places = 64, width = 256;
  double total = 9 * 64 * width * places + 2 * residual(width, width, places) + attention(width, places);
  for (double out : widths) {
    total += residual(width, out, places);
    width = out;
    places *= 4;
  }
  return total + 9 * width * 36 * places / 4;
}

/// Forward and twice that backward, two operations a multiply-add.
Workload network_step(const std::string& name, double multiply_adds, int64_t batch, Run (*prepare)(int64_t)) {
  return {name + ".step.b" + std::to_string(batch),
          3 * 2 * multiply_adds * static_cast<double>(batch),
          0,
          [=] { return prepare(batch); },
          {"torch"}};
}

}  // namespace

void add_network_steps(Workloads& all) {
  all.push_back(network_step("unet", unet_multiply_adds(), 8, prepare_unet));
  all.push_back(network_step("decoder", decoder_multiply_adds(), 4, prepare_decoder));
}

}  // namespace cloam
