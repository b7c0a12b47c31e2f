// A driving log once more, with other boxes or other poses or lenses of its cameras.
#pragma once
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "models/scene/scene.h"

namespace cloam {

/// What was learned of a log.
struct RefinedLog {
  std::vector<Actor> actors = {};                     // those of its boxes that moved or may have, by id and step
  std::map<std::string, Eigen::Matrix4d> poses = {};  // world_from_camera by Frame::name
  std::map<std::string, LensChange> lenses = {};      // by Frame::sensor
};

/// Writes `log`, of which has_room_for holds, into `folder`: all files are linked or copied. In the cuboids position
/// and turn of every box that `refined` has are those given there; other rows and columns stay, but for columns of a
/// kind that we do not read (dates, categories). In a camera's poses.json the entry of a photo moves as its pose did,
/// in the camera's axes; its intrinsics.json has the changed lens (with_lens).
/// Fault::write.
void write_refined_log(const std::filesystem::path& folder, const Scene& log, const RefinedLog& refined);

/// Whether the files of `log`, with these values changed, are read with what was learned and with all else as before.
/// Not where its layout is another than PandaSet's; nor, for cameras, where sweeps take their poses from the front
/// camera (the real PandaSet, whose car is known by its focal lengths), and where a photo lies between two entries of
/// poses.json (Recording::image_stamp).
bool has_room_for(const RefinedLog& refined, const Scene& log);

}  // namespace cloam
