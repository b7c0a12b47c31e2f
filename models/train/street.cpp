// See street.h.
#include "models/train/street.h"

#include "runtime/error.h"

namespace cloam {

AssetName Street::add_asset(const NewAsset&) {
  throw Error(Fault::usage, "the run's assets have no codes: none can be added");
}

}  // namespace cloam
