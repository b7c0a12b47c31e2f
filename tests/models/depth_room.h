// A ball in a room whose walls have one colour each: photos say little of where they are, depth maps all. Drawn here
// alone, in closed form, with OpenGL's camera axes (x right, y up, z back) and z up in the world.
#pragma once
#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "models/io/image.h"
#include "tests/models/folder.h"

namespace cloam {

struct DepthRoom {
  int width = 48, height = 36;
  double focal = 40;  // pixels
  int train = 5, test = 3;

  struct Seat {
    Eigen::Vector3d place, right, up, back;
  };
  /// Those that train, then those that test, between them.
  std::vector<Seat> seats() const {
    std::vector<Seat> all;
    for (int i = 0; i < train + test; ++i) {
      const double share = i < train ? i / (train - 1.0) : (i - train + 0.5) / test, angle = 1.1 * (share - 0.5);
      Seat seat;
      seat.place = {3 * std::sin(angle), 0.6 - 3 * std::cos(angle), 1.1 + 0.5 * std::sin(5 * share)};
      seat.back = (seat.place - Eigen::Vector3d(0, 0.6, 0.5)).normalized();
      seat.right = Eigen::Vector3d::UnitZ().cross(seat.back).normalized();
      seat.up = seat.back.cross(seat.right);
      all.push_back(seat);
    }
    return all;
  }

  struct Seen {
    double depth = std::numeric_limits<double>::infinity();  // along the optical axis
    double distance = 0;                                     // from the camera
    Eigen::Vector3d colour;
  };
  /// At a place in an image of `columns` pixels, which shows as much as a photo.
  Seen look(const Seat& seat, double x, double y, int columns) const {
    const double scale = double(width) / columns;
    const Eigen::Vector3d way =
        (x * scale - 0.5 * width) / focal * seat.right - (y * scale - 0.5 * height) / focal * seat.up - seat.back;
    Seen seen;
    const auto meet = [&](double t, const Eigen::Vector3d& colour) {
      if (t > 0 && t < seen.depth) seen.depth = t, seen.colour = colour;
    };
    meet(-seat.place.z() / way.z(), {0.55, 0.5, 0.4});
    meet((2 - seat.place.y()) / way.y(), {0.3, 0.45, 0.7});
    for (const double side : {-2.2, 2.2}) meet((side - seat.place.x()) / way.x(), {0.75, 0.7, 0.45});
    const Eigen::Vector3d from = seat.place - Eigen::Vector3d(0, 0.6, 0.5);
    const double a = way.squaredNorm(), b = from.dot(way), c = from.squaredNorm() - 0.25, root = b * b - a * c;
    if (root > 0) meet((-b - std::sqrt(root)) / a, {0.8, 0.25, 0.2});
    seen.distance = seen.depth * way.norm();
    return seen;
  }
  /// Of the middles of the pixels of an image of that size.
  std::vector<double> depths(const Seat& seat, int columns, int rows, bool along_ray = false) const {
    std::vector<double> all;
    for (int y = 0; y < rows; ++y)
      for (int x = 0; x < columns; ++x) {
        const Seen seen = look(seat, x + 0.5, y + 0.5, columns);
        all.push_back(along_ray ? seen.distance : seen.depth);
      }
    return all;
  }
  Image photo(const Seat& seat) const {
    Image image{width, height, 3, {}};
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) {
        const Eigen::Vector3d colour = look(seat, x + 0.5, y + 0.5, width).colour;
        for (int k = 0; k < 3; ++k) image.pixels.push_back(static_cast<std::uint8_t>(std::lround(255 * colour[k])));
      }
    return image;
  }

  /// N.png and transforms.json; frame_keys(N), "" or `,"key":value`, stands in frame N, `keys` in the file.
  template <class FrameKeys>
  void write(const std::filesystem::path& folder, const FrameKeys& frame_keys, const std::string& keys = "") const {
    std::string frames, tests;
    const std::vector<Seat> all = seats();
    for (std::size_t i = 0; i < all.size(); ++i) {
      const Seat& s = all[i];
      const std::string name = std::to_string(i) + ".png", comma = frames.empty() ? "" : ",";
      write_png(folder / name, photo(s));
      if (static_cast<int>(i) >= train) tests += (tests.empty() ? "\"" : ",\"") + name + "\"";
      frames += comma + R"({"file_path":")" + name + R"(","transform_matrix":[)";
      for (int row = 0; row < 3; ++row) {
        frames += "[";
        for (const double value : {s.right[row], s.up[row], s.back[row]}) frames += std::to_string(value) + ",";
        frames += std::to_string(s.place[row]) + "],";
      }
      frames += "[0,0,0,1]]" + frame_keys(i) + "}";
    }
    write_text(folder / "transforms.json", R"({"fl_x":)" + std::to_string(focal) + R"(,"w":)" + std::to_string(width) +
                                               R"(,"h":)" + std::to_string(height) + keys + R"(,"test_filenames":[)" +
                                               tests + R"(],"frames":[)" + frames + "]}");
  }
  /// With depth maps of 24x18 in millimetres beside all photos.
  void write_with_depths(const std::filesystem::path& folder, const std::string& keys = "") const {
    const std::vector<Seat> all = seats();
    write(
        folder, [](std::size_t i) { return R"(,"depth_file_path":"depth)" + std::to_string(i) + ".png\""; }, keys);
    for (std::size_t i = 0; i < all.size(); ++i) {
      Labels labels{24, 18, {}};
      for (const double depth : depths(all[i], 24, 18))
        labels.values.push_back(static_cast<std::uint16_t>(std::lround(1000 * depth)));
      write_labels(folder / ("depth" + std::to_string(i) + ".png"), labels);
    }
  }
};

}  // namespace cloam
