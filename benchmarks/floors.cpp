// The floors, as data.
#include "benchmarks/floors.h"

#include <algorithm>

namespace cloam {
namespace {

using Floors = std::vector<Floor>;

void add_products(Floors& all) {
  for (const char* form : {".nn", ".nt", ".tn"}) {
    all.push_back({std::string("matmul.512") + form, 0.93, 1});
    all.push_back({std::string("matmul.1024") + form, 0.93, 1});
    all.push_back({std::string("matmul.2048") + form, 0.90, 1});
  }
  all.insert(all.end(), {{"matmul.65536x64x64.nn", 1, 1.1},
                         {"matmul.65536x64x64.nt", 1, 1.1},
                         {"matmul.64x64x65536.tn", 1.05, 1.2},
                         {"matmul.64x16384x576.nn", 0.8, 1}});
}

void add_convolutions(Floors& all) {
  for (const char* shape : {"3x3.64.128", "3x3.256.32", "5x5.32.270x480"})
    for (const char* batch : {".b1", ".b8"})
      for (const char* what : {".fwd", ".dx", ".dw"})
        all.push_back({std::string("conv.") + shape + batch + what, std::string(what) == ".dw" ? 0.85 : 0.92, 1});
  for (const char* what : {".fwd", ".dx", ".dw"}) {
    all.push_back({std::string("conv.3x3.256.8.b1") + what, 0.92, 1.5});
    all.push_back({std::string("conv.3x3.256.8.b8") + what, 0.75, 1});
  }
}

Floors floors() {
  Floors all;
  add_products(all);
  add_convolutions(all);
  all.insert(all.end(), {{"mlp.4x64.65536.fwd", 3.5, 4.6},
                         {"mlp.4x64.65536.fwd@mkldnn_linear", 1.3, 1.4},
                         {"mlp.4x64.65536.fwdbwd", 3.5, 4.6},
                         {"groupnorm_silu.8x64x128x128.fwd", 1.8, 3},
                         {"groupnorm_silu.8x64x128x128.fwdbwd", 2.1, 3},
                         {"attention.4x1024x64.fwd", 2, 3.8},
                         {"attention.4x1024x64.fwdbwd", 1.5, 3},
                         {"attention.4x2048x64.fwd", 2, 3.8},
                         {"attention.4x2048x64.fwdbwd", 1.5, 3},
                         {"adam.10m", 3, 3.7},
                         {"bias_relu.64m", 2, 2.6},
                         {"triplane.3x32x256.1m.fwdbwd", 3, 10},
                         {"sort.4m.u64", 1, 4},
                         {"splat_blend.800x608.400k.fwd", 8, 12},
                         {"unet.step.b8", 1.2, 2},
                         {"decoder.step.b4", 1.1, 1.5},
                         {"pointwise.1000x4096", 5, 3.5, true}});  // a thousand ops: milliseconds are microseconds each
  return all;
}

}  // namespace

const Floor* floor_of(const std::string& name) {
  static const Floors all = floors();
  const auto found = std::find_if(all.begin(), all.end(), [&](const Floor& f) { return f.name == name; });
  return found == all.end() ? nullptr : &*found;
}

}  // namespace cloam
