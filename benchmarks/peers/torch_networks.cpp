// Whole training steps of networks, as the same graph in libtorch: models/diffusion/unet.h,
// models/fields/asset_decoder.h.
#include <cmath>
#include <memory>

#include "benchmarks/peers/torch.h"

namespace {

namespace nn = torch::nn;
using torch::Tensor;

nn::Conv2d convolution(int64_t in, int64_t out, int64_t side = 3, int64_t stride = 1) {
  return nn::Conv2d(nn::Conv2dOptions(in, out, side).stride(stride).padding(side / 2));
}

nn::GroupNorm norm(int64_t channels) { return nn::GroupNorm(nn::GroupNormOptions(32, channels)); }

Tensor doubled(const Tensor& x) { return torch::upsample_nearest2d(x, {2 * x.size(2), 2 * x.size(3)}); }

struct ResBlockImpl : nn::Module {
  ResBlockImpl(int64_t in, int64_t out, int64_t embedding)
      : norm1(register_module("norm1", norm(in))),
        norm2(register_module("norm2", norm(out))),
        conv1(register_module("conv1", convolution(in, out))),
        conv2(register_module("conv2", convolution(out, out))) {
    if (embedding > 0) project = register_module("project", nn::Linear(embedding, out));
    if (in != out) skip = register_module("skip", convolution(in, out, 1));
  }
  Tensor forward(const Tensor& x, const Tensor& activated) {
    Tensor h = conv1(torch::silu(norm1(x)));
    if (project) h = h + project(activated).unsqueeze(2).unsqueeze(3);
    h = conv2(torch::silu(norm2(h)));
    return h + (skip ? skip(x) : x);
  }
  nn::GroupNorm norm1, norm2;
  nn::Conv2d conv1, conv2, skip{nullptr};
  nn::Linear project{nullptr};
};
TORCH_MODULE(ResBlock);

struct AttentionImpl : nn::Module {
  explicit AttentionImpl(int64_t channels)
      : before(register_module("before", norm(channels))),
        qkv(register_module("qkv", nn::Linear(channels, 3 * channels))),
        out(register_module("out", nn::Linear(channels, channels))) {}
  Tensor forward(const Tensor& x) {
    const int64_t n = x.size(0), c = x.size(1);
    const auto parts = qkv(before(x).reshape({n, c, -1}).transpose(1, 2)).chunk(3, 2);
    const double scale = 1 / std::sqrt(static_cast<double>(c));
    const Tensor mixed =
        torch::bmm(torch::softmax(torch::bmm(parts[0], parts[1].transpose(1, 2)) * scale, -1), parts[2]);
    return x + out(mixed).transpose(1, 2).reshape(x.sizes());
  }
  nn::GroupNorm before;
  nn::Linear qkv, out;
};
TORCH_MODULE(Attention);

constexpr int64_t kBase = 128, kEmbedding = 4 * kBase, kLevels = 3;

struct UnetImpl : nn::Module {
  UnetImpl() {
    time1 = register_module("time1", nn::Linear(kBase, kEmbedding));
    time2 = register_module("time2", nn::Linear(kEmbedding, kEmbedding));
    of_class = register_module("class", nn::Embedding(9, kEmbedding));
    time_of_day = register_module("time_of_day", nn::Embedding(3, kEmbedding));
    enter = register_module("enter", convolution(32, kBase));
    std::vector<int64_t> kept = {kBase};
    int64_t width = kBase;
    for (int64_t level = 0; level < kLevels; level++) {
      for (int i = 0; i < 2; i++) {
        down->push_back(ResBlock(width, kBase << level, kEmbedding));
        kept.push_back(width = kBase << level);
      }
      if (level == kLevels - 1) continue;
      halve->push_back(convolution(width, width, 3, 2));
      kept.push_back(width);
    }
    middle1 = register_module("middle1", ResBlock(width, width, kEmbedding));
    attention = register_module("attention", Attention(width));
    middle2 = register_module("middle2", ResBlock(width, width, kEmbedding));
    for (int64_t level = kLevels - 1; level >= 0; level--) {
      for (int i = 0; i < 3; i++) {
        up->push_back(ResBlock(width + kept.back(), kBase << level, kEmbedding));
        kept.pop_back();
        width = kBase << level;
      }
      if (level > 0) after_doubling->push_back(convolution(width, width));
    }
    register_module("down", down), register_module("halve", halve);
    register_module("up", up), register_module("after_doubling", after_doubling);
    last_norm = register_module("last_norm", norm(kBase));
    leave = register_module("leave", convolution(kBase, 32));
  }

  Tensor embed(const Tensor& t, const Tensor& class_id, const Tensor& day) {
    const Tensor rates = torch::exp(torch::arange(kBase / 2) * (-std::log(10000.0) / (kBase / 2 - 1)));
    const Tensor angles = t.unsqueeze(1) * rates;
    const Tensor time = time2(torch::silu(time1(torch::cat({torch::sin(angles), torch::cos(angles)}, 1))));
    return torch::silu(time + of_class(class_id) + time_of_day(day));
  }

  Tensor forward(const Tensor& noisy, const Tensor& t, const Tensor& class_id, const Tensor& day) {
    const Tensor embedded = embed(t, class_id, day);
    Tensor h = enter(noisy);
    std::vector<Tensor> kept = {h};
    for (size_t i = 0; i < down->size(); i++) {
      kept.push_back(h = down[i]->as<ResBlock>()->forward(h, embedded));
      if (i % 2 == 1 && i + 1 < down->size()) kept.push_back(h = halve[i / 2]->as<nn::Conv2d>()->forward(h));
    }
    h = middle2(attention(middle1(h, embedded)), embedded);
    for (size_t i = 0; i < up->size(); i++) {
      h = up[i]->as<ResBlock>()->forward(torch::cat({h, kept.back()}, 1), embedded);
      kept.pop_back();
      if (i % 3 == 2 && i + 1 < up->size()) h = after_doubling[i / 3]->as<nn::Conv2d>()->forward(doubled(h));
    }
    return leave(torch::silu(last_norm(h)));
  }

  nn::Linear time1{nullptr}, time2{nullptr};
  nn::Embedding of_class{nullptr}, time_of_day{nullptr};
  nn::Conv2d enter{nullptr}, leave{nullptr};
  nn::ModuleList down, halve, up, after_doubling;
  ResBlock middle1{nullptr}, middle2{nullptr};
  Attention attention{nullptr};
  nn::GroupNorm last_norm{nullptr};
};
TORCH_MODULE(Unet);

struct DecoderImpl : nn::Module {
  DecoderImpl() {
    of_class = register_module("class", nn::Embedding(8, 32));
    enter = register_module("enter", convolution(64, 256));
    middle1 = register_module("middle1", ResBlock(256, 256, 0));
    attention = register_module("attention", Attention(256));
    middle2 = register_module("middle2", ResBlock(256, 256, 0));
    int64_t width = 256;
    for (int64_t out : {256, 128, 128, 64, 64}) {
      stages->push_back(ResBlock(width, out, 0));
      width = out;
    }
    register_module("stages", stages);
    last_norm = register_module("last_norm", norm(width));
    leave = register_module("leave", convolution(width, 36));
  }
  Tensor forward(const Tensor& latent, const Tensor& class_id) {
    const int64_t n = latent.size(0);
    const Tensor tiled = of_class(class_id).reshape({n, 32, 1, 1}).expand({n, 32, latent.size(2), latent.size(3)});
    Tensor h = middle1(enter(torch::cat({latent, tiled}, 1)), Tensor());
    h = middle2(attention(h), Tensor());
    for (size_t i = 0; i < stages->size(); i++)
      h = stages[i]->as<ResBlock>()->forward(i == 0 ? h : doubled(h), Tensor());
    return leave(torch::silu(last_norm(h)));
  }
  nn::Embedding of_class{nullptr};
  nn::Conv2d enter{nullptr}, leave{nullptr};
  ResBlock middle1{nullptr}, middle2{nullptr};
  Attention attention{nullptr};
  nn::ModuleList stages;
  nn::GroupNorm last_norm{nullptr};
};
TORCH_MODULE(Decoder);

/// Forward, backward and Adam, with images and weights in one of the two layouts.
struct Training {
  torch::MemoryFormat format;
  std::vector<Tensor> parameters = {};
  std::unique_ptr<torch::optim::Adam> adam = {};

  Tensor image(const torch::IntArrayRef& shape) const { return torch::randn(shape).contiguous(format); }
  void optimise(const nn::Module& module) {
    for (Tensor& p : module.parameters()) {
      if (p.dim() == 4) p.set_data(p.contiguous(format));
      parameters.push_back(p);
    }
    adam = std::make_unique<torch::optim::Adam>(parameters, torch::optim::AdamOptions(1e-4));
  }
  void step(const Tensor& loss) const {
    loss.backward();
    adam->step();
    for (Tensor p : parameters) p.mutable_grad().reset();  // cheaper than filling them with zeros
  }
};

peer::Run prepare_unet(torch::MemoryFormat format, int64_t batch) {
  auto training = std::make_shared<Training>(Training{format});
  Unet unet;
  training->optimise(*unet);
  const Tensor x = training->image({batch, 32, 8, 8}), noise = training->image({batch, 32, 8, 8});
  const Tensor t = torch::randint(1000, {batch}), class_id = torch::randint(8, {batch}, torch::kLong),
               day = torch::randint(2, {batch}, torch::kLong);
  const Tensor kept = torch::cumprod(1 - torch::linspace(1e-4, 0.02, 1000), 0).index({t.to(torch::kLong)});
  const Tensor alpha = kept.sqrt().reshape({batch, 1, 1, 1}), sigma = (1 - kept).sqrt().reshape({batch, 1, 1, 1});
  return [=]() mutable {
    const Tensor v = unet(alpha * x + sigma * noise, t, class_id, day);
    training->step(torch::mse_loss(v, alpha * noise - sigma * x));
  };
}

peer::Run prepare_decoder(torch::MemoryFormat format, int64_t batch) {
  auto training = std::make_shared<Training>(Training{format});
  Decoder decoder;
  const Tensor latent = training->image({batch, 32, 8, 8}).requires_grad_();
  decoder->register_parameter("latent", latent);
  training->optimise(*decoder);
  const Tensor planes = training->image({batch, 36, 128, 128}), class_id = torch::randint(8, {batch}, torch::kLong);
  return [=]() mutable { training->step(torch::mse_loss(decoder(latent, class_id), planes)); };
}

}  // namespace

void add_networks(peer::Works& all) {
  const std::pair<const char*, torch::MemoryFormat> layouts[] = {{"@nchw", torch::MemoryFormat::Contiguous},
                                                                 {"@nhwc", torch::MemoryFormat::ChannelsLast}};
  for (const auto& [way, format] : layouts) {
    all.push_back({std::string("unet.step.b8") + way, [format] { return prepare_unet(format, 8); }});
    all.push_back({std::string("decoder.step.b4") + way, [format] { return prepare_decoder(format, 4); }});
  }
}
