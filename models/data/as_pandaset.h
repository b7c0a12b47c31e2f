// A log of any source as PandaSet's layout can hold it.
#pragma once
#include <map>
#include <string>
#include <vector>

#include "models/scene/scene.h"

namespace cloam {

/// A log whose cameras have PandaSet's names.
struct PandasetLog {
  Scene scene;
  std::map<std::string, std::string> renamed;  // the new name by the old one, of cameras that PandaSet does not have
};
/// `log` as the layout can hold it, with a pinhole for each of log.cameras. Its times and poses count as those of the
/// middles of sweeps and images, so nothing is left for a reader to correct; boxes are where their actors are at the
/// times of their steps. Fault::usage for more than six cameras, and for one that has several lenses.
PandasetLog as_pandaset(const Scene& log, const std::vector<Camera>& pinholes);

}  // namespace cloam
