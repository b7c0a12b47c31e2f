// Capability: some of its parameters are networks that do not belong to one scene, and can be handed on to other runs.
#pragma once
#include "models/io/tensors.h"

namespace cloam {

/// The parameters that are handed on have names that begin with this.
constexpr char kNetworks[] = "networks.";
inline TensorMap networks_in(const TensorMap& parameters) { return with_prefix(parameters, kNetworks); }

/// Such a method's setting that says whether they stand still: true in runs that take another's. Not for users to set.
constexpr char kNetworksFrozen[] = "networks.frozen";

class SharesNetworks {
 public:
  virtual ~SharesNetworks() = default;
  /// After build: takes the networks among the parameters of another run. Fault::usage for networks of other sizes.
  virtual void adopt_networks(const TensorMap& parameters) = 0;
};

}  // namespace cloam
