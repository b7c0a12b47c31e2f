// Distances by features of a frozen network, for reports. Those of the published Inception's features are FID and KID;
// others bear the network's name, since values compare only among themselves, neither with FID and KID nor with LPIPS
// (whose weights of channels were learned).
#pragma once
#include <Eigen/Core>
#include <string>

#include "models/nn/feature_network.h"

namespace cloam {

/// Of a network by its name: "feature distance (squeezenet-1.0)"; likewise "Frechet feature distance (...)" and "kernel
/// feature distance (...)", which are "FID" and "KID" of the published Inception.
std::string feature_distance_name(const std::string& network, const std::string& kind = "");

/// LPIPS's form (Zhang et al. 2018, eq. 1) with all channels' weights 1: features scaled to length 1 over the channels
/// of each place, squared difference, mean over places, mean over taps. a, b [N,3,H,W] in [0,1] -> [N], from 0 to 2.
Tensor feature_distance(const FeatureNetwork& network, const Tensor& a, const Tensor& b);

/// The deepest tap's mean over places, a row an image: images [N,3,H,W] in [0,1] -> [N,C]. They are rounded to bytes
/// first, so that pictures in memory count as those in files.
Eigen::MatrixXd pooled_features(const FeatureNetwork& network, const Tensor& images);

/// |difference of means|^2 + tr(A + B - 2 (A B)^(1/2)) of two sets of features [N,C] and [M,C] with the covariances A
/// and B, divided by N - 1 and M - 1 (Heusel et al. 2017, eq. 6). N or M below C + 1 leaves covariances singular:
/// figures then depend on the number of images. Fault::data for sets of less than two rows.
double frechet_distance(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b);

/// Unbiased squared maximum mean discrepancy with the kernel (x.y / C + 1)^3 (Binkowski et al. 2018, KID's), of the
/// whole sets at once; below 0 at times when they are alike. Errors as frechet_distance.
double kernel_distance(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b);

struct Subsets {
  int64_t size = 1000;
  int count = 100;
  uint64_t seed = 0;
};
struct SubsetDistance {
  double mean, deviation;  // over subsets
  int subsets;
};
/// kernel_distance of subsets drawn without repeats, as KID is reported (100 of 1000). A set that is no larger than a
/// subset is taken whole; if both are, that is one distance, without a deviation.
SubsetDistance kernel_distance_of_subsets(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b,
                                          const Subsets& subsets = {});

/// What reports say of two sets of features [N,C] and [M,C].
struct SetDistances {
  double frechet;
  SubsetDistance kernel;
  int64_t images_a, images_b, features;
};
SetDistances set_distances(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b);

}  // namespace cloam
