// A forward-facing capture as LLFF leaves one, drawn and written here alone: leaves before a wall, seen by a grid of
// cameras that all look one way. OpenGL's axes throughout (x right, y up, z back), by which LLFF's are defined.
#pragma once
#include <Eigen/Geometry>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <random>
#include <string>
#include <vector>

namespace cloam {

struct ForwardFacing {
  int width = 48, height = 36, columns = 5, rows = 4, leaves = 14;
  double focal = 44;  // pixels

  /// Of one camera.
  struct Seat {
    Eigen::Vector3d place, right, up, back;
  };
  std::vector<Seat> seats;
  double nearest = 2, farthest = 12;

  explicit ForwardFacing(int wide = 48, int count = 14) : width(wide), height(wide * 3 / 4), leaves(count) {
    focal = 44.0 / 48 * wide;
    std::mt19937 random(7);  // NOLINT: the same leaves each time
    const auto uniform = [&](double low, double high) {
      return low + (high - low) * static_cast<double>(random()) / 4294967296.0;
    };
    for (int i = 0; i < leaves; ++i) {
      Leaf leaf;
      leaf.middle = {uniform(-2.2, 2.2), uniform(-1.6, 1.6), uniform(-7, -2.2)};
      leaf.turn = uniform(0, 3.14);
      leaf.length = uniform(0.3, 0.9);
      leaf.colour = {uniform(0.05, 0.4), uniform(0.4, 0.9), uniform(0.05, 0.4)};
      all_.push_back(leaf);
    }
    for (int i = 0; i < columns * rows; ++i) {
      Seat seat;
      seat.place = {1.2 * (i % columns) / (columns - 1) - 0.6 + uniform(-0.05, 0.05),
                    0.8 * (i / columns) / (rows - 1) - 0.4 + uniform(-0.05, 0.05), uniform(-0.08, 0.08)};
      seat.back = (seat.place - Eigen::Vector3d(0, 0, -6)).normalized();
      seat.right = Eigen::Vector3d::UnitY().cross(seat.back).normalized();
      seat.up = seat.back.cross(seat.right);
      seats.push_back(seat);
    }
  }

  /// RGB by rows, 2x2 rays a pixel.
  std::vector<std::uint8_t> photo(const Seat& seat) const {
    std::vector<std::uint8_t> rgb;
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) {
        Eigen::Vector3d sum = Eigen::Vector3d::Zero();
        for (int k = 0; k < 4; ++k) {
          const double u = (x + 0.25 + 0.5 * (k % 2) - 0.5 * width) / focal,
                       v = (y + 0.25 + 0.5 * (k / 2) - 0.5 * height) / focal;
          sum += colour(seat.place, u * seat.right - v * seat.up - seat.back) / 4;
        }
        for (int c = 0; c < 3; ++c) rgb.push_back(static_cast<std::uint8_t>(std::lround(255 * sum[c])));
      }
    return rgb;
  }

  /// Of what pixels' centres show, along their rays.
  std::vector<double> distances(const Seat& seat) const {
    std::vector<double> all;
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) {
        const double u = (x + 0.5 - 0.5 * width) / focal, v = (y + 0.5 - 0.5 * height) / focal;
        const Eigen::Vector3d way = u * seat.right - v * seat.up - seat.back;
        double first = 0;
        colour(seat.place, way, &first);
        all.push_back(first * way.norm());
      }
    return all;
  }

  /// LLFF's row of a camera: 3x5 by rows with the axes down, right, back; then the depths.
  std::vector<double> row(const Seat& seat) const {
    std::vector<double> numbers;
    const double size[] = {double(height), double(width), focal};
    for (int i = 0; i < 3; ++i)
      numbers.insert(numbers.end(), {-seat.up[i], seat.right[i], seat.back[i], seat.place[i], size[i]});
    numbers.insert(numbers.end(), {nearest, farthest});
    return numbers;
  }

 private:
  struct Leaf {
    Eigen::Vector3d middle, colour;
    double turn = 0, length = 0;
  };
  std::vector<Leaf> all_;

  Eigen::Vector3d colour(const Eigen::Vector3d& from, const Eigen::Vector3d& way, double* steps = nullptr) const {
    const double wall = (-12 - from.z()) / way.z();
    const Eigen::Vector3d there = from + wall * way;
    const double brick =
        0.5 + 0.35 * std::sin(2.2 * there.x() + 0.6 * std::sin(1.1 * there.y())) * std::cos(2.6 * there.y());
    Eigen::Vector3d seen(0.9 * brick, 0.55 * brick + 0.1, 0.35 + 0.3 * std::sin(0.7 * there.x()));
    double first = wall;
    for (const Leaf& leaf : all_) {
      const double t = (leaf.middle.z() - from.z()) / way.z();
      if (t <= 0 || t >= first) continue;
      const Eigen::Vector3d at = from + t * way - leaf.middle;
      const double along = (std::cos(leaf.turn) * at.x() + std::sin(leaf.turn) * at.y()) / leaf.length,
                   across = (std::cos(leaf.turn) * at.y() - std::sin(leaf.turn) * at.x()) / (0.35 * leaf.length);
      if (along * along + across * across > 1) continue;
      first = t;
      seen = leaf.colour * (0.75 + 0.25 * std::sin(14 * along + 6 * std::abs(across)));
    }
    if (steps) *steps = first;
    return seen.cwiseMax(0).cwiseMin(1);
  }
};

/// An .npy of version 1 as numpy writes it: '<f8' or another type, C's or Fortran's order.
inline std::string npy_bytes(const std::string& type, const std::string& shape, const std::string& content,
                             bool fortran = false) {
  std::string header =
      "{'descr': '" + type + "', 'fortran_order': " + (fortran ? "True" : "False") + ", 'shape': (" + shape + "), }";
  while ((10 + header.size() + 1) % 64 != 0) header += ' ';
  header += '\n';
  const std::string sizes = {char(header.size() % 256), char(header.size() / 256)};
  return std::string("\x93NUMPY\x01") + '\0' + sizes + header + content;
}

template <class Number>
std::string bytes_of_numbers(const std::vector<double>& numbers) {
  std::string bytes;
  for (const double number : numbers) {
    const Number value = static_cast<Number>(number);
    bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
  }
  return bytes;
}

}  // namespace cloam
