// See export_splats.h.
#include "cli/export_splats.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "cli/output_path.h"
#include "models/gaussians/formats.h"
#include "models/gaussians/turn.h"
#include "models/metrics/psnr.h"
#include "models/render/undistort.h"
#include "models/splat/draw.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kViews = 3;  // that a file is looked at from

std::vector<float> picture(const Gaussians& gaussians, const Scene& scene, const Frame& frame) {
  const Camera camera = pinhole_around(scene.cameras[static_cast<std::size_t>(frame.camera)]);
  std::vector<float> values =
      draw(splat_model(gaussians), camera, view_matrix(frame.world_from_camera), {1e-3f}).planes.to_host();
  for (float& value : values) value = std::min(value, 1.f);
  return values;
}

/// The least of a few views.
double likeness_of(const Gaussians& written, const Gaussians& model, const Scene& scene) {
  double least = std::numeric_limits<double>::infinity();
  const std::size_t every = std::max<std::size_t>(1, scene.frames.size() / kViews);
  for (std::size_t i = 0; i < scene.frames.size(); i += every)
    least = std::min(least, psnr(picture(written, scene, scene.frames[i]), picture(model, scene, scene.frames[i])));
  return least;
}

}  // namespace

int export_splats(const RestoredRun& run, const Gaussians& gaussians, const SplatExport& request,
                  const Common& common) {
  const fs::path path = with_format(request.out, request.format);
  write_gaussians(path, gaussians);
  const SplatFile read = read_gaussians(path);
  for (const std::string& warning : read.warnings) warn(warning);
  const double decibel = likeness_of(turned(read.gaussians, gaussians.up), gaussians, run.scenes.front());
  if (common.json) {
    nlohmann::ordered_json json = {
        {"schema_version", 1}, {"path", path.string()}, {"gaussians", read.gaussians.count()}};
    json["psnr_to_model"] = std::isfinite(decibel) ? nlohmann::ordered_json(decibel) : nullptr;
    put_json(json);
    return 0;
  }
  const std::string same = std::isfinite(decibel) ? fmt::format("match the model at {:.1f} dB", decibel)
                                                  : std::string("equal the model's, bit for bit");
  put(text(path.string(), ": ", read.gaussians.count(), " Gaussians; read back, its renders ", same, "\n"));
  return 0;
}

}  // namespace cloam
