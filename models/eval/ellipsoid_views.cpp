// See ellipsoid_views.h.
#include "models/eval/ellipsoid_views.h"

#include "models/gaussians/ellipsoids.h"
#include "models/gaussians/exports_actors.h"
#include "models/gaussians/exports_gaussians.h"
#include "models/gaussians/turn.h"
#include "models/gaussians/values.h"

namespace cloam {
namespace {

constexpr double kSolid = 0.2;  // opacity

/// In the world of the view's scene.
Gaussians gaussians_at(const RestoredRun& run, const View& view) {
  if (const auto* exports = as<ExportsGaussians>(*run.method)) return exports->gaussians();
  const auto& street = *as<ExportsActors>(*run.method);
  Gaussians all = street.background_gaussians();
  for (const Actor& actor : run.scenes[static_cast<std::size_t>(view.scene)].actors) {
    const auto world_from_box = world_from_box_at(actor, view.time);
    if (!world_from_box) continue;
    Gaussians placed = street.actor_gaussians(actor.asset.value_or(AssetName{view.scene, actor.id}));
    transform(placed, {world_from_box->block<3, 3>(0, 0), 1, world_from_box->block<3, 1>(0, 3)});
    append(all, placed);
  }
  return all;
}

}  // namespace

bool has_ellipsoids(const RestoredRun& run) {
  return as<ExportsGaussians>(*run.method) || as<ExportsActors>(*run.method);
}

Picture ellipsoids_seen(const RestoredRun& run, const View& view) {
  const auto* exports = as<ExportsGaussians>(*run.method);
  const GaussianDrawing drawing = exports ? exports->drawing() : GaussianDrawing();
  return ellipsoid_picture(gaussians_at(run, view), view, {1, kSolid, drawing.near, drawing.white ? 1.0 : 0.0});
}

}  // namespace cloam
