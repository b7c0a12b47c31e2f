// Single ops in libtorch, each as its users would write it for speed: fused calls, results written in place where the
// library can, gradients by its autograd (which needs no zeroing: grad() returns fresh tensors).
#include "benchmarks/peers/torch.h"

namespace {

namespace F = torch::nn::functional;
using torch::Tensor;

/// Adds NAME and NAME@channels_last, prepared with the memory format.
void add_both_layouts(peer::Works& all, const std::string& name,
                      const std::function<peer::Run(const std::string&, torch::MemoryFormat)>& prepare) {
  all.push_back({name, [=] { return prepare(name, torch::MemoryFormat::Contiguous); }});
  all.push_back({name + "@channels_last", [=] { return prepare(name, torch::MemoryFormat::ChannelsLast); }});
}

/// conv.RxR.C.SIZE.bN.what: C channels in and out, stride 1, same padding; SIZE is a side or HxW.
peer::Run convolution(const std::string& name, torch::MemoryFormat format) {
  const auto parts = peer::fields(name), size = peer::fields(parts[3], 'x');
  const int64_t taps = number(parts[1].substr(0, 1)), channels = number(parts[2]), batch = number(parts[4]);
  const Tensor x = torch::randn({batch, channels, number(size.front()), number(size.back())}).contiguous(format);
  const Tensor w = torch::randn({channels, channels, taps, taps}).contiguous(format);
  const int64_t pad = taps / 2;
  if (parts[5] == "fwd") return without_gradient([=] { torch::conv2d(x, w, {}, 1, pad); });
  const Tensor dy = torch::randn_like(x);
  const bool input = parts[5] == "dx";
  return without_gradient([=] {
    torch::convolution_backward(dy, x, w, c10::nullopt, {1, 1}, {pad, pad}, {1, 1}, false, {0, 0}, 1,
                                {input, !input, false});
  });
}

/// mlp.LxW.N.what: L layers W -> W without bias, ReLU between them; the gradient goes to weights and input.
struct Mlp {
  Tensor x;
  std::vector<Tensor> weights;  // [in, out], as ours

  explicit Mlp(const std::string& name, bool tracked) {
    const auto parts = peer::fields(name), layers = peer::fields(parts[1], 'x');
    const int64_t width = number(layers[1]);
    x = torch::randn({number(parts[2]), width}).requires_grad_(tracked);
    for (int64_t i = 0; i < number(layers[0]); i++)
      weights.push_back((torch::randn({width, width}) * std::sqrt(2.0 / double(width))).requires_grad_(tracked));
  }
  Tensor forward() const {
    Tensor y = x;
    for (std::size_t i = 0; i < weights.size(); i++) {
      y = torch::mm(y, weights[i]);
      if (i + 1 < weights.size()) y = torch::relu_(y);
    }
    return y;
  }
};

peer::Run mlp_forward(const std::string& name) {
  const auto mlp = std::make_shared<Mlp>(name, false);
  return without_gradient([=] { mlp->forward(); });
}

peer::Run mlp_both(const std::string& name) {
  const auto mlp = std::make_shared<Mlp>(name, true);
  const Tensor dy = torch::randn_like(mlp->x);
  std::vector<Tensor> wanted = mlp->weights;
  wanted.push_back(mlp->x);
  return [=] { torch::autograd::grad({mlp->forward()}, wanted, {dy}); };
}

/// oneDNN's inner product instead of the BLAS; libtorch offers it for inference alone.
peer::Run mlp_by_mkldnn(const std::string& name) {
  const auto mlp = std::make_shared<Mlp>(name, false);
  std::vector<Tensor> weights;
  for (const Tensor& w : mlp->weights) weights.push_back(w.t().contiguous().to_mkldnn());
  return without_gradient([=] {
    Tensor y = mlp->x.to_mkldnn();
    for (std::size_t i = 0; i < weights.size(); i++) {
      y = torch::mkldnn_linear(y, weights[i]);
      if (i + 1 < weights.size()) y = torch::relu_(y);
    }
    y.to_dense();
  });
}

/// groupnorm_silu.NxCxHxW.what: 32 groups, then SiLU; the gradient goes to x, gamma and beta.
peer::Run group_norm(const std::string& name) {
  const auto parts = peer::fields(name), size = peer::fields(parts[1], 'x');
  const bool tracked = parts[2] == "fwdbwd";
  const int64_t channels = number(size[1]);
  const Tensor x = torch::randn({number(size[0]), channels, number(size[2]), number(size[3])}).requires_grad_(tracked);
  const Tensor gamma = torch::ones({channels}).requires_grad_(tracked);
  const Tensor beta = torch::zeros({channels}).requires_grad_(tracked);
  if (!tracked)
    return without_gradient([=] {
      Tensor y = torch::group_norm(x, 32, gamma, beta);
      torch::silu_(y);
    });
  const Tensor dy = torch::randn_like(x);
  return [=] { torch::autograd::grad({torch::silu(torch::group_norm(x, 32, gamma, beta))}, {x, gamma, beta}, {dy}); };
}

/// attention.BxTxD.what: softmax(q kᵀ / sqrt(D)) v for B heads of T queries and keys.
peer::Run attention(const std::string& name) {
  const auto parts = peer::fields(name), size = peer::fields(parts[1], 'x');
  const bool tracked = parts[2] == "fwdbwd";
  const auto input = [&] {
    return torch::randn({number(size[0]), number(size[1]), number(size[2])}).requires_grad_(tracked);
  };
  const Tensor q = input(), k = input(), v = input();
  const double scale = 1 / std::sqrt(double(number(size[2])));
  const auto forward = [=] { return torch::bmm(torch::softmax(torch::bmm(q * scale, k.transpose(1, 2)), -1), v); };
  if (!tracked) return without_gradient([=] { forward(); });
  const Tensor dy = torch::randn_like(q);
  return [=] { torch::autograd::grad({forward()}, {q, k, v}, {dy}); };
}

/// layernorm.LxC.what: over rows of C.
peer::Run layer_norm(const std::string& name) {
  const auto parts = peer::fields(name), size = peer::fields(parts[1], 'x');
  const bool tracked = parts[2] == "fwdbwd";
  const int64_t width = number(size[1]);
  const Tensor x = torch::randn({number(size[0]), width}).requires_grad_(tracked);
  const Tensor gamma = torch::ones({width}).requires_grad_(tracked);
  const Tensor beta = torch::zeros({width}).requires_grad_(tracked);
  if (!tracked) return without_gradient([=] { torch::layer_norm(x, {width}, gamma, beta); });
  const Tensor dy = torch::randn_like(x);
  return [=] { torch::autograd::grad({torch::layer_norm(x, {width}, gamma, beta)}, {x, gamma, beta}, {dy}); };
}

/// softmax.LxC.what: over rows of C.
peer::Run softmax(const std::string& name) {
  const auto parts = peer::fields(name), size = peer::fields(parts[1], 'x');
  const bool tracked = parts[2] == "fwdbwd";
  const Tensor x = torch::randn({number(size[0]), number(size[1])}).requires_grad_(tracked);
  if (!tracked) return without_gradient([=] { torch::softmax(x, -1); });
  const Tensor dy = torch::randn_like(x);
  return [=] { torch::autograd::grad({torch::softmax(x, -1)}, {x}, {dy}); };
}

/// adam.10m: one parameter tensor of ten million numbers, libtorch's own optimiser.
peer::Run adam(const std::string&) {
  Tensor parameter = torch::randn({10'000'000}).requires_grad_();
  parameter.mutable_grad() = torch::randn_like(parameter);
  const auto optimiser = std::make_shared<torch::optim::Adam>(std::vector<Tensor>{parameter});
  return [=] { optimiser->step(); };
}

/// bias_relu.64m: x [1M, 64] + bias [64], ReLU, into a tensor that exists.
peer::Run bias_relu(const std::string&) {
  const Tensor x = torch::randn({int64_t{1} << 20, 64}), bias = torch::randn({64}), out = torch::empty_like(x);
  return without_gradient([=] {
    Tensor y = out;
    torch::add_out(y, x, bias);
    torch::relu_(y);
  });
}

/// pointwise.1000x4096: a thousand small ops one after the other.
peer::Run many_small(const std::string& name) {
  const auto size = peer::fields(peer::fields(name)[1], 'x');
  const int64_t count = number(size[0]);
  const Tensor x = torch::randn({number(size[1])}), y = torch::randn({number(size[1])});
  return without_gradient([=] {
    Tensor z = x;
    for (int64_t i = 0; i < count; i++) z = i % 2 == 0 ? torch::add(z, y) : torch::mul(z, y);
  });
}

/// triplane.3xCxSIDE.S.fwdbwd: features of S random points from three planes; the gradient goes to the planes.
/// grid_sample takes coordinates in [-1, 1]; border padding and half-pixel centres as ours.
peer::Run planes(const std::string& name, torch::MemoryFormat format) {
  const auto parts = peer::fields(name), size = peer::fields(parts[1], 'x');
  const int64_t channels = number(size[1]), side = number(size[2]), samples = number(parts[2]);
  torch::manual_seed(0);
  const Tensor points = torch::rand({samples, 3}) * 2 - 1;
  const auto pair = [&](int64_t a, int64_t b) { return torch::stack({points.select(1, a), points.select(1, b)}, 1); };
  const Tensor where = torch::stack({pair(0, 1), pair(0, 2), pair(1, 2)}).unsqueeze(1);  // [3, 1, S, 2]
  const Tensor planes = torch::randn({3, channels, side, side}).contiguous(format).requires_grad_();
  const Tensor dy = torch::randn({3, channels, 1, samples}).contiguous(format);
  const auto how = F::GridSampleFuncOptions().mode(torch::kBilinear).padding_mode(torch::kBorder).align_corners(false);
  return [=] { torch::autograd::grad({F::grid_sample(planes, where, how)}, {planes}, {dy}); };
}

void add(peer::Works& all, const std::string& name, peer::Run (*prepare)(const std::string&)) {
  all.push_back({name, [=] { return prepare(name); }});
}

}  // namespace

void add_convolutions(peer::Works& all) {
  for (const char* shape : {"3x3.64.128", "3x3.256.32", "3x3.256.8", "5x5.32.270x480"})
    for (const char* batch : {".b1", ".b8"})
      for (const char* what : {".fwd", ".dx", ".dw"})
        add_both_layouts(all, std::string("conv.") + shape + batch + what, convolution);
}

void add_mlps(peer::Works& all) {
  add(all, "mlp.4x64.65536.fwd", mlp_forward);
  all.push_back({"mlp.4x64.65536.fwd@mkldnn_linear", [] { return mlp_by_mkldnn("mlp.4x64.65536.fwd"); }});
  add(all, "mlp.4x64.65536.fwdbwd", mlp_both);
}

void add_norms(peer::Works& all) {
  for (const char* what : {".fwd", ".fwdbwd"}) {
    for (const char* size : {"8x64x128x128", "8x256x32x32"})
      add(all, std::string("groupnorm_silu.") + size + what, group_norm);
    add(all, std::string("layernorm.65536x256") + what, layer_norm);
    add(all, std::string("softmax.65536x256") + what, softmax);
  }
}

void add_attentions(peer::Works& all) {
  for (const char* size : {"4x1024x64.", "4x2048x64.", "64x64x64."})
    for (const char* what : {"fwd", "fwdbwd"}) add(all, std::string("attention.") + size + what, attention);
}

void add_streams(peer::Works& all) {
  add(all, "adam.10m", adam);
  add(all, "bias_relu.64m", bias_relu);
  add(all, "pointwise.1000x4096", many_small);
}

void add_planes(peer::Works& all) { add_both_layouts(all, "triplane.3x32x256.1m.fwdbwd", planes); }
