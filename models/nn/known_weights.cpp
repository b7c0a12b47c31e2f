// See known_weights.h. The first eight digits stand in the names that PyTorch's hub gives files; the rest was read in
// public lists of checksums, several that agree for each.
#include "models/nn/known_weights.h"

#include <algorithm>
#include <array>

namespace cloam {
namespace {

constexpr std::array kKnown = {
    KnownWeights{kInception, "6726825d0af5f729cebd5821db510b11b1cfad8faad88a03f1befd49fb9129b2",
                 "pt_inception-2015-12-05-6726825d.pth", "pytorch-fid; torch-fidelity"},
    KnownWeights{kAlexNet, "7be5be791159472b1fbf3c69796f7cb30dca7ad8466c2df70058c37116cdee02",
                 "alexnet-owt-7be5be79.pth", "torchvision"},
    KnownWeights{kVgg16, "397923af8e79cdbb6a7127f12361acd7a2f83e06b05044ddf496e83de57a5bf0", "vgg16-397923af.pth",
                 "torchvision"},
    KnownWeights{kLpipsAlex, "df73285e35b22355a2df87cdb6b70b343713b667eddbda73e1977e0c860835c0", "alex.pth",
                 "PerceptualSimilarity, lpips/weights/v0.1"},
    KnownWeights{kLpipsVgg, "a78928a0af1e5f0fcb1f3b9e8f8c3a2a5a3de244d830ad5c1feddc79b8432868", "vgg.pth",
                 "PerceptualSimilarity, lpips/weights/v0.1"}};

}  // namespace

std::span<const KnownWeights> known_weights() { return kKnown; }

bool is_published(std::string_view network, std::string_view sha256) {
  return std::any_of(kKnown.begin(), kKnown.end(),
                     [&](const KnownWeights& known) { return known.network == network && known.sha256 == sha256; });
}

std::string name_by_weights(std::string_view network, bool published) {
  return std::string(network) + (published ? "" : ", unverified weights");
}

}  // namespace cloam
