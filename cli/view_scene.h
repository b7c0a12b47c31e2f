// scene.json: what the viewer's page needs to know before it draws anything.
#pragma once
#include <nlohmann/json.hpp>

#include "models/gaussians/gaussians.h"
#include "models/runs/run_folder.h"
#include "models/scene/scene.h"

namespace cloam {

/// Where the page's camera begins, and around what it turns.
nlohmann::ordered_json scene_of_gaussians(const std::string& title, const Gaussians& gaussians);

/// Of a scene that is rendered: its cameras at the size of the training images.
nlohmann::ordered_json scene_of_captures(const std::string& title, const std::string& method, const Scene& scene,
                                         int downscale);

/// Twelve numbers, row by row.
nlohmann::ordered_json pose_json(const Eigen::Matrix4d& pose);
nlohmann::ordered_json vector_json(const Eigen::Vector3d& vector);

}  // namespace cloam
