// Evaluations of runs side by side, and the means of those that differ by their seeds alone.
#pragma once
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "models/runs/run_folder.h"

namespace cloam {

struct ComparedRun {
  std::string run;  // its folder
  RunRecord record;
  nlohmann::ordered_json eval;  // what eval.json holds
};
using RunGroup = std::vector<const ComparedRun*>;  // runs that are averaged

struct ComparedFigure {
  const char *key, *heading;
};

// Keys of eval.json (docs/formats.md).
inline const std::vector<ComparedFigure> kComparedFigures = {{"psnr", "PSNR"},
                                                             {"ssim", "SSIM"},
                                                             {"masked_psnr", "masked PSNR"},
                                                             {"masked_ssim", "masked SSIM"},
                                                             {"moving_psnr", "moving PSNR"},
                                                             {"lidar_median_error_m", "LiDAR m"},
                                                             {"lidar_chamfer_m2", "Chamfer m2"},
                                                             {"lpips", "LPIPS"},
                                                             {"masked_lpips", "masked LPIPS"},
                                                             {"perceptual_distance", "perceptual"},
                                                             {"masked_perceptual_distance", "masked perceptual"},
                                                             {"feature_distance", "features"},
                                                             {"masked_feature_distance", "masked features"},
                                                             {"frechet_feature_distance", "Frechet features"},
                                                             {"kernel_feature_distance", "kernel features"},
                                                             {"fid", "FID"},
                                                             {"kid", "KID"},
                                                             {"baseline_mean_colour_psnr", "mean colour"},
                                                             {"baseline_nearest_frame_psnr", "nearest"},
                                                             {"baseline_blend_psnr", "blend"},
                                                             {"baseline_blend_masked_psnr", "masked blend"},
                                                             {"baseline_mean_masked_psnr", "masked mean"},
                                                             {"baseline_blend_moving_psnr", "moving blend"}};

struct Mean {
  double mean, deviation;  // of a sample: divided by n - 1
};

/// Of what eval.json holds; empty and nothing for another type, or if it is not there.
std::string word(const nlohmann::ordered_json& eval, const char* key);
std::optional<double> figure(const nlohmann::ordered_json& eval, const char* key);

/// Runs of two and more that only the seed tells apart, or with across_data also their data.
std::vector<RunGroup> groups_of(const std::vector<ComparedRun>& runs, bool across_data);
/// Nothing unless every run has the figure.
std::optional<Mean> mean_of(const RunGroup& group, const char* key);

/// What `compare --json` prints.
nlohmann::ordered_json to_json(const std::vector<ComparedRun>& runs, const std::vector<RunGroup>& groups);

}  // namespace cloam
