// cloam convert: files of gaussians from one format to another, read again after writing.
#include <fmt/format.h>

#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>

#include "cli/commands.h"
#include "models/gaussians/formats.h"
#include "models/gaussians/spz.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr char kConvertExamples[] =
    R"(Convert Gaussian splats between .ply, .splat, .spz and .glb; the extensions choose the formats.

Examples:
  cloam convert scene.ply scene.spz
  cloam convert scene.spz scene.glb
  cloam convert points.ply scene.ply --up z       # a coloured point cloud becomes round Gaussians
  cloam convert scene.ply scene.spz --spz-version 2

The output is read back, and the largest error of each quantity is printed.)";

struct ConvertRequest {
  std::string in, out, up;
  int spz_version = 3;
};

const std::map<std::string, Eigen::Vector3d> kAxes = {{"x", {1, 0, 0}},   {"y", {0, 1, 0}},   {"z", {0, 0, 1}},
                                                      {"-x", {-1, 0, 0}}, {"-y", {0, -1, 0}}, {"-z", {0, 0, -1}}};

Eigen::Vector3d axis_named(const std::string& name) {
  const auto found = kAxes.find(name);
  if (found == kAxes.end()) throw Error(Fault::usage, "--up " + name + ": want one of x, y, z, -x, -y, -z");
  return found->second;
}

void write(const ConvertRequest& request, const Gaussians& gaussians) {
  const bool is_spz = std::string(splat_format(request.out).extension) == ".spz";
  if (is_spz && request.spz_version != 3) {
    write_spz(request.out, gaussians, request.spz_version);
  } else {
    write_gaussians(request.out, gaussians);
  }
}

std::string lines_of(const SplatErrors& errors) {
  return fmt::format(
      "largest errors: positions {:.3g}, deviations {:.3g} %, rotations {:.3g} degrees, opacities {:.3g}, colours "
      "{:.3g}, coefficients of degrees 1 to 3 {:.3g}\n",
      errors.position, 100 * errors.scale, errors.rotation, errors.opacity, errors.colour, errors.harmonics);
}

/// Also through links: what is read must not be replaced.
void check_other_file(const ConvertRequest& request) {
  std::error_code ignored;
  if (fs::equivalent(request.in, request.out, ignored))
    throw Error(Fault::usage, text(request.out, " is the input file; name another file to write"));
}

int run_convert(const ConvertRequest& request, const Common& common) {
  splat_format(request.out);  // an unknown name is told before anything is read
  check_other_file(request);
  SplatFile file = read_gaussians(request.in);
  Gaussians& gaussians = file.gaussians;
  for (const std::string& warning : file.warnings) warn(warning);
  if (!request.up.empty()) gaussians.up = axis_named(request.up);
  write(request, gaussians);
  const SplatErrors errors = reread_errors(request.out, gaussians);
  if (common.json) {
    put_json({{"schema_version", 1},
              {"path", request.out},
              {"gaussians", gaussians.count()},
              {"up", {gaussians.up.x(), gaussians.up.y(), gaussians.up.z()}},
              {"position_error", errors.position},
              {"deviation_error", errors.scale},
              {"rotation_error_degrees", errors.rotation},
              {"opacity_error", errors.opacity},
              {"colour_error", errors.colour},
              {"harmonics_error", errors.harmonics},
              {"warnings", file.warnings}});
  } else {
    put(text(request.out, ": ", gaussians.count(), " gaussians\n", lines_of(errors)));
  }
  return 0;
}

}  // namespace

Command add_convert(CLI::App& program) {
  return command<ConvertRequest>(
      program, "convert", kConvertExamples, run_convert, [](const Options& add, ConvertRequest& r) {
        add("IN", r.in, "Input file: .ply, .splat, .spz or .glb").required();
        add("OUT", r.out, "Output file: .ply, .splat, .spz or .glb", output_file()).required();
        add("--up", r.up, "Axis of IN that points up: x, y, z, -x, -y or -z (default: as IN states, else -y)");
        add("--spz-version", r.spz_version, "Version of .spz to write: 3, or 2 for old readers (3)",
            whole_number(2, 3));
      });
}

}  // namespace cloam
