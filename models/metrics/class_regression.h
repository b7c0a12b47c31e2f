// Which class rows of features are of: multinomial logistic regression, for figures that ask whether pictures show what
// they should.
#pragma once
#include <Eigen/Core>
#include <map>
#include <vector>

namespace cloam {

/// A class a row, and the group that the row is from: rows of one group are alike for other reasons, too.
struct LabelledRows {
  Eigen::MatrixXd rows;
  std::vector<int> classes, groups;
};

class ClassRegression {
 public:
  /// Least mean of -log p over classes, in which all rows of one count alike, plus strength / 2 times the squares of
  /// the weights of features, which are standardised (to their mean and deviation over the rows). Convex: found by
  /// L-BFGS (Liu and Nocedal 1989) from zero. Fault::data for rows of less than two classes.
  ClassRegression(const LabelledRows& rows, double strength);
  /// Ascending; columns of what follows.
  const std::vector<int>& classes() const { return classes_; }
  Eigen::MatrixXd log_probabilities(const Eigen::MatrixXd& rows) const;

 private:
  Eigen::MatrixXd standardised(const Eigen::MatrixXd& rows) const;

  std::vector<int> classes_;
  Eigen::RowVectorXd mean_, deviation_;
  Eigen::MatrixXd weights_;  // [features + 1, classes]; the last row: offsets
};

/// The strength, a power of ten, that makes rows of groups which are left out likeliest, all of their classes alike:
/// four folds of whole groups, or as many as there are groups. Fault::data for less than two groups.
double likeliest_strength(const LabelledRows& rows);

/// The share of rows whose likeliest class is right.
struct Accuracy {
  double plain = 0;                                 // of all rows
  double balanced = 0;                              // the mean of the classes' own
  std::map<int, std::map<int, double>> named = {};  // of a class, the share of its rows that each class is likeliest of
};
Accuracy accuracy(const Eigen::MatrixXd& log_probabilities, const std::vector<int>& columns,
                  const std::vector<int>& classes);

}  // namespace cloam
