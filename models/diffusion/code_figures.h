// What samples of codes are worth, by the codes alone: whether they are copies.
#pragma once
#include <vector>

namespace cloam {

using Code = std::vector<float>;

/// Codes of one length and the class of each.
struct LabelledCodes {
  std::vector<Code> codes;
  std::vector<int> classes;
  std::size_t count() const { return classes.size(); }
  void add(const Code& code, int asset_class) {
    codes.push_back(code);
    classes.push_back(asset_class);
  }
};

/// The median distance (root mean square of the numbers) of samples to the nearest training code, over the median
/// distance between two training codes: near 0 for copies. Of at most 400 training codes, evenly taken, for the second.
double copy_ratio(const LabelledCodes& samples, const LabelledCodes& training);

}  // namespace cloam
