// Shapes, strides, broadcasting, and the one way to check an op's arguments: match().
#pragma once
#include <array>
#include <cstdint>
#include <initializer_list>
#include <map>
#include <string>

namespace cloam {

constexpr int kMaxRank = 8;

/// Extents (or strides) of up to kMaxRank axes, outermost first. No heap: a training step makes thousands.
class Shape {
 public:
  Shape() = default;
  Shape(std::initializer_list<int64_t> sizes);
  static Shape filled(int rank, int64_t value);
  int rank() const { return rank_; }
  int64_t operator[](int axis) const { return sizes_[static_cast<size_t>(axis)]; }
  int64_t& operator[](int axis) { return sizes_[static_cast<size_t>(axis)]; }
  int64_t back() const { return sizes_[static_cast<size_t>(rank_ - 1)]; }
  void push_back(int64_t size);
  const int64_t* begin() const { return sizes_.data(); }
  const int64_t* end() const { return sizes_.data() + rank_; }
  bool operator==(const Shape& other) const;

 private:
  std::array<int64_t, kMaxRank> sizes_{};
  int rank_ = 0;
};

/// Fault::memory where they are too many to be counted.
int64_t numel(const Shape& shape);
std::string to_string(const Shape& shape);
Shape dense_strides(const Shape& shape);
/// NumPy's rule; throws, naming `op` and both shapes, when an axis fits neither size nor 1.
Shape broadcast(const char* op, const Shape& a, const Shape& b);
/// Axis counted from the front; a negative one counts from the back. Throws when outside the rank.
int axis_of(const char* op, int rank, int axis);

class Tensor;
/// Sizes named by a pattern: after {"x", x, "N C H W"}, dims["C"] is the channel count.
struct Dims : std::map<std::string, int64_t> {
  int64_t operator[](const std::string& name) const { return at(name); }
};
struct Want {
  const char* name;
  const Tensor& tensor;
  const char* pattern;
};
/// Matches every tensor against its pattern. A letter used twice must mean one size; a number is that size.
/// Throws Fault::internal as "[op] name has shape S, want [P]: why".
Dims match(const char* op, std::initializer_list<Want> wants);

}  // namespace cloam
