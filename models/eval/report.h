// What an evaluation found, as JSON and as files in the run folder.
#pragma once
#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "models/eval/evaluate.h"
#include "models/eval/lidar_scores.h"
#include "models/metrics/feature_distance.h"

namespace cloam {

struct MeasuredActor {
  std::string id, label;  // the source's word for what it is
  bool moves = false;     // goes somewhere (scene.h)
};

/// Of one capture or log.
struct SceneResult {
  std::string name;  // of its folder
  std::vector<ImageScore> images;
  LidarScores lidar;
  std::size_t truth_masks = 0;             // images whose masks of actors are exact; of the others boxes stand for them
  std::vector<MeasuredActor> actors = {};  // in the order of Scene::actors
};

struct EvalResult {
  std::string protocol, train_protocol;
  std::vector<SceneResult> scenes;
  bool has_masks = false;  // photos with pixels that do not count
  bool is_log = false;
  std::string features;                        // name of the feature network; empty: none
  std::string perceptual;                      // name of the network of LPIPS or of its form; empty: none
  std::optional<SetDistances> sets;            // of rotate360: of renders and source images, their actors alone
  std::optional<SetDistances> sets_without_0;  // the same without the renders of actors as they were recorded
  std::string method, preset;
  int64_t step = 0;
  int downscale = 1;
  double seconds = 0;
};

/// schema_version of what evaluations of images write.
constexpr int kEvalSchema = 2;

nlohmann::ordered_json to_json(const EvalResult& result);
/// The scene's, in their order.
std::vector<MeasuredActor> measured_actors(const Scene& scene);

/// eval.json (with each image), per_image.csv and, of logs, per_actor.csv.
void write_reports(const std::filesystem::path& folder, const EvalResult& result);

/// Of all scenes, one after the other.
std::vector<ImageScore> all_images(const EvalResult& result);
LidarScores all_lidar(const EvalResult& result);

}  // namespace cloam
