// Data sets that a test has written by Python with nothing but its own library: another hand than ours.
#pragma once
#include <doctest/doctest.h>

#include <Eigen/Dense>
#include <cstdlib>
#include <nlohmann/json.hpp>

#include "models/io/image.h"
#include "models/io/json.h"
#include "models/scene/scene.h"
#include "tests/models/folder.h"

namespace cloam {

/// Says that a case is skipped.
inline bool no_python() {
  if (std::system("/usr/bin/python3 -c 'import json' >/dev/null 2>&1") == 0) return false;
  MESSAGE("skipped: no python3");
  return true;
}

inline Eigen::Vector3d vector_of(const Json& json) {
  return {json[0].get<double>(), json[1].get<double>(), json[2].get<double>()};
}

/// Landmarks are where `pixels` has them in the frame's image: [x, y], or [] where it does not see one. How many it
/// sees.
inline int check_landmarks(const Scene& scene, const Frame& frame, const Json& landmarks, const Json& pixels) {
  int seen = 0;
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    if (pixels[i].empty()) continue;
    const Eigen::Vector4d at = frame.world_from_camera.inverse() * vector_of(landmarks[i]).homogeneous();
    const Eigen::Vector2d pixel = project(scene.cameras[static_cast<std::size_t>(frame.camera)], at.head<3>());
    CHECK((pixel - Eigen::Vector2d(pixels[i][0].get<double>(), pixels[i][1].get<double>())).norm() < 1e-3);
    ++seen;
  }
  return seen;
}

/// What a program writes into a folder. Its truth.json tells what cloam is to find; each image of "pixels" there is
/// written beside it, grey and 160x90.
struct WrittenByPython {
  Folder folder;
  std::filesystem::path root;
  bool made = false;

  explicit WrittenByPython(const char* program) : root(std::filesystem::canonical(folder.path)) {
    write_text(root / "write.py", program);
    made = std::system(("cd '" + root.string() + "' && /usr/bin/python3 write.py").c_str()) == 0;
    if (!made) return;
    const Json all = truth();
    for (const auto& [name, pixels] : all.at("pixels").items()) {
      std::filesystem::create_directories((root / name).parent_path());
      write_jpeg(root / name, {160, 90, 3, std::vector<std::uint8_t>(160 * 90 * 3, 90)});
    }
  }
  Json truth() const { return parse_json_file(root / "truth.json"); }
};

}  // namespace cloam
