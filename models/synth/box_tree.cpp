// See box_tree.h.
#include "models/synth/box_tree.h"

#include <algorithm>
#include <numeric>

namespace cloam {
namespace {

constexpr int kLeaf = 3;

}

BoxTree::BoxTree(const std::vector<Eigen::AlignedBox3d>& boxes) : boxes_(boxes), order_(boxes.size()) {
  if (boxes.empty()) return;
  std::iota(order_.begin(), order_.end(), 0);
  nodes_.reserve(2 * boxes.size());
  nodes_.emplace_back();
  split(0, 0, static_cast<int>(boxes.size()));
}

void BoxTree::split(std::size_t node, int first, int count) {
  Eigen::AlignedBox3d all;
  for (int i = first; i < first + count; ++i) all.extend(boxes_[std::size_t(order_[std::size_t(i)])]);
  nodes_[node].box = all;
  if (count <= kLeaf) {
    nodes_[node].first = first;
    nodes_[node].count = count;
    return;
  }
  int axis = 0;
  all.sizes().maxCoeff(&axis);
  const int half = count / 2;
  const auto begin = order_.begin() + first;
  std::nth_element(begin, begin + half, begin + count, [&](int a, int b) {
    const double x = boxes_[std::size_t(a)].center()[axis], y = boxes_[std::size_t(b)].center()[axis];
    return x < y || (x == y && a < b);
  });
  const std::size_t children = nodes_.size();
  nodes_[node].children = static_cast<int>(children);
  nodes_.resize(children + 2);
  split(children, first, half);
  split(children + 1, first + half, count - half);
}

}  // namespace cloam
