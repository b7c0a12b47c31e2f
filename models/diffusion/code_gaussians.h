// What is known of codes without a network: a Gaussian of each class and time of day with its full covariance, samples
// of it, and the best denoiser that there is for it. What a diffusion must beat.
#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "models/diffusion/noise_schedule.h"

namespace cloam {

/// N standardised codes of d numbers, a row each. A code is its mean and noise of its own variance.
struct CodeTable {
  Eigen::MatrixXd means, drawn;  // drawn: with noise, as a denoiser sees them
  Eigen::MatrixXd variances;     // of the codes' own noise; of no size where codes are plain
  std::vector<int> classes, nights;
  Eigen::Index count() const { return means.rows(); }
};

/// Covariances of few codes in many dimensions: a mixture of the group's own one, the pooled one of all groups and the
/// diagonal of that. The weights add up to 1; that of the diagonal is above 0.
struct Shrinkage {
  double own = 0, pooled = 0, diagonal = 1;
};

class CodeGaussians {
 public:
  /// A class and time of day with 20 codes or more is a group; what has fewer counts with its whole class. A class with
  /// fewer takes the pooled covariance for its own, and one of which there is no code the mean of all. The codes' own
  /// variance is the mean over all codes. Of more than 2000 codes that many are used, evenly taken.
  CodeGaussians(const CodeTable& codes, const Shrinkage& shrinkage);
  const Shrinkage& shrinkage() const { return shrinkage_; }
  const Eigen::VectorXd& mean(int asset_class, bool night) const;
  Eigen::MatrixXd covariance(int asset_class, bool night) const;
  /// The n-th of a seed is always the same.
  Eigen::VectorXd sample(int asset_class, bool night, uint64_t seed, uint64_t n) const;
  /// E[v | x_t] of noisy codes [M,d] whose classes and times of day are known (Wiener's filter): x^ = m + alpha S
  /// (alpha^2 S + sigma^2)^-1 (x_t - alpha m), v^ = (alpha x_t - x^) / sigma. alpha and sigma above 0.
  Eigen::MatrixXd velocity(const Eigen::MatrixXd& noisy, const std::vector<int>& classes,
                           const std::vector<int>& nights, const Level& level) const;
  /// Of drawn codes, the mean a code.
  double log_likelihood(const CodeTable& codes) const;

 private:
  struct Group {
    int asset_class, night;
    Eigen::VectorXd mean;
    std::vector<Eigen::Index> members;  // rows that its covariance is made of
    double share;                       // of a member in that
    bool own;                           // they are its own, not all
  };
  void add_groups(const CodeTable& codes);
  void add_group(const CodeTable& codes, int asset_class, int night);
  std::size_t group_of(int asset_class, bool night) const;
  std::vector<std::vector<Eigen::Index>> by_group(const std::vector<int>& classes,
                                                  const std::vector<int>& nights) const;
  Eigen::VectorXd diagonal() const;

  Shrinkage shrinkage_;
  std::vector<Group> groups_;      // the last one: all
  Eigen::MatrixXd rows_;           // [N,d]: means less those of their groups
  double pooled_share_ = 0;        // of a row in the pooled covariance
  Eigen::VectorXd noise_, total_;  // [d]: the codes' own variance; diagonal of the pooled covariance
};

/// The weights with the highest likelihood of drawn codes that were left out, over three folds that the seed draws: the
/// diagonal's first, with one covariance for all groups, then the groups' own, then the diagonal's again.
Shrinkage likeliest_shrinkage(const CodeTable& codes, uint64_t seed);

}  // namespace cloam
