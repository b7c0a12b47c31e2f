// See formats.h.
#include "models/gaussians/formats.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cctype>
#include <cmath>
#include <numbers>

#include "models/gaussians/compressed_ply.h"
#include "models/gaussians/dot_splat.h"
#include "models/gaussians/gaussian_glb.h"
#include "models/gaussians/gaussian_ply.h"
#include "models/gaussians/spz.h"
#include "models/gaussians/turn.h"
#include "models/gaussians/values.h"
#include "models/io/words.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

void write_newest_spz(const fs::path& path, const Gaussians& gaussians) { write_spz(path, gaussians); }

constexpr SplatFormat kFormats[] = {
    {"PlayCanvas's compressed .ply", ".compressed.ply", read_gaussian_ply, write_compressed_ply, compressed_order},
    {"3D Gaussian Splatting's .ply", ".ply", read_gaussian_ply, write_gaussian_ply},
    {"the web viewers' .splat", ".splat", read_dot_splat, write_dot_splat},
    {"Niantic's .spz", ".spz", read_spz, write_newest_spz},
    {"glTF with KHR_gaussian_splatting", ".glb", read_gaussian_glb, write_gaussian_glb},
    {"GaussianSplats3D's .ksplat", ".ksplat", nullptr, nullptr},
};

// "a, b and c" of the formats that can be read, or written.
std::string extensions(bool written) {
  std::string all;
  for (const SplatFormat& format : kFormats) {
    if (written ? format.write != nullptr : format.read != nullptr)
      all += (all.empty() ? "" : ", ") + std::string(format.extension);
  }
  return all;
}

Eigen::Quaterniond rotation_of(const Gaussians& gaussians, std::size_t g) {
  const float* q = &gaussians.rotations[4 * g];
  return Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized();
}

double largest(const std::vector<float>& a, const std::vector<float>& b, double (*difference)(double, double)) {
  double most = 0;
  for (std::size_t i = 0; i < a.size(); ++i) most = std::max(most, difference(double(a[i]), double(b[i])));
  return most;
}

double distance(double a, double b) { return std::abs(a - b); }

SplatErrors compare(const Gaussians& given, const Gaussians& found) {
  SplatErrors errors;
  errors.position = largest(given.means, found.means, distance);
  errors.scale = largest(given.scales, found.scales, [](double a, double b) { return std::abs(std::expm1(b - a)); });
  errors.opacity =
      largest(given.opacities, found.opacities, [](double a, double b) { return distance(sigmoid(a), sigmoid(b)); });
  errors.colour = kSphericalFirst * largest(given.sh_first, found.sh_first, distance);
  errors.harmonics = largest(given.sh_rest, found.sh_rest, distance);
  for (std::size_t g = 0; g < given.count(); ++g) {
    const Eigen::Quaterniond between = rotation_of(given, g).conjugate() * rotation_of(found, g);
    const double angle = 2 * std::atan2(between.vec().norm(), std::abs(between.w()));
    errors.rotation = std::max(errors.rotation, angle * 180 / std::numbers::pi);
  }
  return errors;
}

Gaussians ordered(const Gaussians& gaussians, const std::vector<std::size_t>& places) {
  Gaussians out = gaussians;
  for (const GaussianArray& array : kGaussianArrays)
    for (std::size_t i = 0; i < places.size(); ++i)
      std::copy_n(&(gaussians.*array.values)[array.width * places[i]], array.width,
                  &(out.*array.values)[array.width * i]);
  return out;
}

}  // namespace

std::span<const SplatFormat> splat_formats() { return kFormats; }

const SplatFormat& splat_format(const fs::path& path, bool write) {
  const std::string extension = lower_case(path.extension().string()), name = lower_case(path.filename().string());
  std::vector<std::string> names;
  for (const SplatFormat& format : kFormats) {
    if (!extension.empty() && name.ends_with(format.extension)) return format;
    names.push_back(format.extension);
  }
  throw Error(Fault::usage, text(path.string(), ": cannot ", write ? "write " : "read ",
                                 extension.empty() ? "a file without an extension" : extension,
                                 "; supported: ", extensions(write), did_you_mean(extension, names)));
}

SplatFile read_gaussians(const fs::path& path) {
  const SplatFormat& format = splat_format(path, false);
  if (!format.read)
    bad_data(path.string(), ": ", format.name, " is not supported; save the scene as one of ", extensions(false),
             " with the program that made it");
  SplatFile file = format.read(path);
  const std::size_t count = file.gaussians.count(), unsound = drop_unsound(file.gaussians);
  if (unsound > 0) {
    file.warnings.push_back(text(path.string(), ": ", unsound, " of ", count, " Gaussians left out: they have values ",
                                 "that are not finite, or a rotation of length 0"));
  }
  if (file.gaussians.count() == 0) bad_data(path.string(), ": holds no Gaussians");
  return file;
}

void write_gaussians(const fs::path& path, const Gaussians& gaussians) {
  const SplatFormat& format = splat_format(path);
  if (!format.write) {
    throw Error(Fault::usage,
                text(path.string(), ": ", format.name, " cannot be written; choose one of ", extensions(true)));
  }
  format.write(path, gaussians);
}

SplatErrors reread_errors(const fs::path& path, const Gaussians& gaussians) {
  const Gaussians found = read_gaussians(path).gaussians;
  if (found.count() != gaussians.count()) {
    throw Error(Fault::verification,
                text(path.string(), ": ", gaussians.count(), " Gaussians were written, ", found.count(),
                     " are read back: some have values that the format cannot hold"));
  }
  const Gaussians given = turned(gaussians, found.up);
  const auto order = splat_format(path).order;
  return compare(order ? ordered(given, order(gaussians)) : given, found);
}

}  // namespace cloam
