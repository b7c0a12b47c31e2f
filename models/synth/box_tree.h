// A tree of boxes: which of many things may a ray meet? Median split of the longest side, a few boxes a leaf.
#pragma once
#include <Eigen/Geometry>
#include <vector>

#include "models/synth/ray_cast.h"

namespace cloam {

class BoxTree {
 public:
  explicit BoxTree(const std::vector<Eigen::AlignedBox3d>& boxes);

  /// Calls visit(index) for the boxes that the ray meets before `limit`, a reference to which visit may shorten; one
  /// below 0 ends the search.
  template <class Visit>
  void along(const Ray& ray, const double& limit, Visit visit) const {
    if (nodes_.empty()) return;
    const Eigen::Vector3d inverse = ray.direction.unaryExpr([](double d) { return 1 / (d == 0 ? 1e-200 : d); });
    int stack[64], depth = 0;
    stack[depth++] = 0;
    while (depth > 0) {
      const Node& node = nodes_[static_cast<std::size_t>(stack[--depth])];
      if (!meets(node.box, ray, inverse, limit)) continue;
      for (int i = node.first; i < node.first + node.count; ++i) {
        const auto index = static_cast<std::size_t>(order_[static_cast<std::size_t>(i)]);
        if (meets(boxes_[index], ray, inverse, limit)) visit(index);
      }
      if (node.count > 0) continue;
      stack[depth++] = node.children;
      stack[depth++] = node.children + 1;
    }
  }

 private:
  struct Node {
    Eigen::AlignedBox3d box;
    int first = 0, count = 0;  // of a leaf, in order_
    int children = 0;          // two, side by side
  };

  static bool meets(const Eigen::AlignedBox3d& box, const Ray& ray, const Eigen::Vector3d& inverse, double limit) {
    const Eigen::Array3d a = (box.min() - ray.origin).cwiseProduct(inverse),
                         b = (box.max() - ray.origin).cwiseProduct(inverse);
    return std::max(a.min(b).maxCoeff(), 0.0) <= std::min(a.max(b).minCoeff(), limit);
  }

  void split(std::size_t node, int first, int count);

  std::vector<Eigen::AlignedBox3d> boxes_;
  std::vector<int> order_;
  std::vector<Node> nodes_;
};

}  // namespace cloam
