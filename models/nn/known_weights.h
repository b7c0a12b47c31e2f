// Published files of weights by their checksums. A metric bears its true name (FID, LPIPS) only with the weights that
// it is defined by, and only a checksum tells that they are those.
#pragma once
#include <span>
#include <string>
#include <string_view>

namespace cloam {

constexpr char kInception[] = "inception-v3-2015-12-05";
constexpr char kAlexNet[] = "alexnet", kVgg16[] = "vgg-16";
constexpr char kLpipsAlex[] = "lpips-alex-v0.1", kLpipsVgg[] = "lpips-vgg-v0.1";  // the linear layers

struct KnownWeights {
  std::string_view network;  // as reports name it
  std::string_view sha256;   // of the whole file, 64 digits
  std::string_view file, origin;
};

std::span<const KnownWeights> known_weights();

bool is_published(std::string_view network, std::string_view sha256);

/// The network's name in reports: with ", unverified weights" unless they are published ones.
std::string name_by_weights(std::string_view network, bool published);

}  // namespace cloam
