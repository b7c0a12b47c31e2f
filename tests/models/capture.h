// A capture written by hand, a transforms.json and images, in a temporary folder.
#pragma once
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "models/io/image.h"
#include "tests/models/folder.h"

namespace cloam {

inline const std::string kPose = "[[1,0,0,2],[0,0,-1,3],[0,1,0,4],[0,0,0,1]]";

/// A capture in a temporary folder.
class Capture : public Folder {
 public:
  void text_file(const std::string& name, const std::string& content) const { std::ofstream(path / name) << content; }

  void image(const std::string& name, int width, int height, std::vector<std::uint8_t> colour) const {
    Image image{width, height, static_cast<int>(colour.size()), {}};
    for (int i = 0; i < width * height; ++i) image.pixels.insert(image.pixels.end(), colour.begin(), colour.end());
    std::filesystem::create_directories((path / name).parent_path());
    write_png(path / name, image);
  }
};

inline std::string frame(const std::string& image, const std::string& pose = kPose, const std::string& more = "") {
  return R"({"file_path":")" + image + R"(","transform_matrix":)" + pose + more + "}";
}

/// An 8x6 capture whose one frame is given as JSON.
inline std::string capture(const std::string& frames, const std::string& more = R"("fl_x":10,"w":8,"h":6)") {
  return "{" + more + R"(,"frames":[)" + frames + "]}";
}

}  // namespace cloam
