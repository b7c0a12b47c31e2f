// A driving log of any layout once more in PandaSet's, with the photos and LiDAR that were recorded.
#pragma once
#include <filesystem>

#include "models/data/as_pandaset.h"
#include "models/runs/listener.h"

namespace cloam {

/// Writes `log` into a new folder, with its poses, lenses and boxes as they are in the Scene (also where those are not
/// the ones that its files have). JPEG and PNG photos of pinholes are linked or copied, others are written as JPEG,
/// those of other lenses as pinholes take them (pinhole_within). Masks are left out, with a warning: the layout has
/// none. With skip_bad photos and sweeps that are damaged are left out, with a warning; else they are Fault::data.
/// Fault::usage for a folder that is not empty, and as as_pandaset; Fault::write. Where it fails, and where it is asked
/// to stop, it removes the folder.
void write_recorded_log(const std::filesystem::path& folder, const Scene& log, bool skip_bad, const Listener& listener);

/// Says which cameras got other names.
void tell_renamed(const PandasetLog& log, const Listener& listener);

}  // namespace cloam
