// What a diffusion's samples are worth against photographs: the same ones for every prior and every decoder.
#pragma once
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <set>
#include <string>
#include <vector>

#include "models/eval/photo_crops.h"
#include "models/eval/showroom.h"
#include "models/latents/generates_assets.h"
#include "models/metrics/class_regression.h"

namespace cloam {

class PhotoFigures {
 public:
  /// Chooses photos, and which assets stand for them; nothing is rendered yet. Errors of held_out_crops. Tells which
  /// figures there cannot be.
  PhotoFigures(GeneratesAssets& prior, const PhotoCrops& photos, const Listener& listener);
  /// How many assets add() shows.
  std::size_t expected() const;
  /// Keys are documented in docs/formats.md.
  void add(Showroom& showroom, const Listener& listener, nlohmann::ordered_json& figures) const;
  /// Names of the photos that sets are held against.
  std::vector<std::string> files() const;

 private:
  void match(const std::vector<NewAsset>& training);
  void choose_classes(const std::vector<NewAsset>& training);
  void add_distances(Showroom& showroom, const Eigen::MatrixXd& features, nlohmann::ordered_json& figures) const;
  /// Photos of the classes that are told apart, by features of their pictures and by the sides of their boxes.
  struct ClassPhotos {
    LabelledRows pictures, boxes;
    std::set<std::string> logs;
  };
  ClassPhotos class_photos(const Eigen::MatrixXd& features, bool held_out) const;
  std::vector<NewAsset> assets_of_classes(CodeSource source) const;
  void add_classes(Showroom& showroom, const Eigen::MatrixXd& features, nlohmann::ordered_json& figures) const;

  GeneratesAssets& prior_;
  int pixels_;
  double height_;  // of the photos' cameras above the horizon, as actors see it: the median, radians
  std::vector<PhotoCrop> photos_;
  std::vector<bool> held_out_;        // of photos_
  std::vector<std::size_t> matched_;  // places in photos_, which sets are held against
  std::vector<NewAsset> training_;    // by class and time of day, which stand for them
  std::vector<std::size_t> shown_;    // for each of them, a place in training_ or any other set like it
  std::map<int, int> classes_;        // that are told apart, and how many training assets of each are shown
};

}  // namespace cloam
