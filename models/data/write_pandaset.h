// A driving log in PandaSet's layout, with pickles that pandas reads.
#pragma once
#include <filesystem>
#include <functional>

#include "models/data/load_sweep.h"
#include "models/io/image.h"
#include "models/scene/scene.h"

namespace cloam {

/// What a Scene leaves on disk, asked for one at a time.
struct LogContent {
  std::function<Image(const Frame&)> image;  // RGB, of its camera's size
  std::function<LidarPoints(const Sweep&)> points;
};

/// Writes images, LiDAR, cuboids and meta files of `log` below `root`, each file whole and durably. Times and poses are
/// written as they are: those of the stamps that log.recording speaks of. Steps run from 0; a
/// camera that lacks one (readers then say so) gets the pose before it. Files of another log in `root` stay.
/// Fault::usage for cameras with a lens, which the layout cannot hold; Fault::write.
void write_pandaset(const std::filesystem::path& root, const Scene& log, const LogContent& content);

/// The same in parts, in any order: an image, a sweep, and all else once they are there.
void write_pandaset_image(const std::filesystem::path& root, const Scene& log, const Frame& frame, const Image& image);
void write_pandaset_sweep(const std::filesystem::path& root, const Sweep& sweep, const LidarPoints& points);
void write_pandaset_rest(const std::filesystem::path& root, const Scene& log);

}  // namespace cloam
