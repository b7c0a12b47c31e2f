// See gaussian_ply.h.
#include "models/gaussians/gaussian_ply.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "models/gaussians/compressed_ply.h"
#include "models/gaussians/initialise.h"
#include "models/gaussians/values.h"
#include "models/io/ply.h"
#include "models/io/words.h"
#include "models/scene/point_ply.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr char kMetric[] = "unit metre", kUp[] = "up ";

// "up X Y Z" with three finite numbers that are not all 0; other people's comments may begin with "up" too.
std::optional<Eigen::Vector3d> up_of(const std::string& comment) {
  if (!comment.starts_with(kUp)) return {};
  std::string_view rest = std::string_view(comment).substr(sizeof kUp - 1);
  Eigen::Vector3d up;
  for (double& value : up) value = number_in<double>(next_word(rest)).value_or(NAN);
  const bool sound = rest.empty() && up.allFinite() && up.norm() > 0;
  return sound ? std::optional(up) : std::nullopt;
}

using Places = std::vector<std::size_t>;  // of properties in a row

Places places_of(const PlyHeader& header, const char* prefix, std::size_t count) {
  Places places;
  for (std::size_t i = 0; i < count; ++i) places.push_back(header.index(text(prefix, i)));
  return places;
}

void copy(std::span<const float> row, const Places& places, float* target) {
  for (const std::size_t place : places) *target++ = row[place];
}

// Of each coefficient red, green, blue, as Gaussians have them.
Places rest_places(const PlyHeader& header) {
  const auto count = static_cast<std::size_t>(
      std::count_if(header.properties.begin(), header.properties.end(),
                    [](const PlyProperty& property) { return property.name.starts_with("f_rest_"); }));
  const std::size_t coefficients = count / 3;
  if (count != 0 && count != 9 && count != 24 && count != 45)
    bad_data(header.file, ": its vertices have ", count, " properties f_rest_N, want 0, 9, 24 or 45 (degree 0 to 3)");
  const Places by_channel = places_of(header, "f_rest_", count);
  Places places;
  for (std::size_t k = 0; k < coefficients; ++k) {
    for (std::size_t channel = 0; channel < 3; ++channel) places.push_back(by_channel[channel * coefficients + k]);
  }
  return places;
}

PlyRow gaussian_rows(const PlyHeader& header, Gaussians& gaussians) {
  const Places means{header.index("x"), header.index("y"), header.index("z")};
  const Places first = places_of(header, "f_dc_", 3), rest = rest_places(header);
  const Places scales = places_of(header, "scale_", 3), rotation = places_of(header, "rot_", 4);
  const std::size_t opacity = header.index("opacity");
  gaussians = zero_gaussians(header.count, header.file);
  return [=, &gaussians, g = std::size_t{0}](std::span<const float> row) mutable {
    copy(row, means, &gaussians.means[3 * g]);
    copy(row, first, &gaussians.sh_first[3 * g]);
    copy(row, rest, &gaussians.sh_rest[3 * kSphericalRest * g]);
    copy(row, scales, &gaussians.scales[3 * g]);
    copy(row, rotation, &gaussians.rotations[4 * g]);
    gaussians.opacities[g] = row[opacity];
    ++g;
  };
}

PlyHeader header_of(const Gaussians& gaussians, std::size_t coefficients) {
  PlyHeader header;
  header.count = gaussians.count();
  header.comments = comments_of(gaussians);
  const auto add = [&](const char* prefix, std::size_t count) {
    for (std::size_t i = 0; i < count; ++i) header.properties.push_back({text(prefix, i)});
  };
  for (const char* name : {"x", "y", "z", "nx", "ny", "nz"}) header.properties.push_back({name});
  add("f_dc_", 3);
  add("f_rest_", 3 * coefficients);
  header.properties.push_back({"opacity"});
  add("scale_", 3);
  add("rot_", 4);
  return header;
}

}  // namespace

void take_comments(const std::vector<std::string>& comments, Gaussians& gaussians) {
  gaussians.up = -Eigen::Vector3d::UnitY();
  for (const std::string& comment : comments) {
    if (const auto up = up_of(comment)) gaussians.up = *up;
    if (comment == kMetric) gaussians.metric = true;
  }
}

std::vector<std::string> comments_of(const Gaussians& gaussians) {
  const Eigen::Vector3d up = gaussians.up.array() + 0.0;  // no negative zeros
  std::vector<std::string> comments = {fmt::format("{}{} {} {}", kUp, up.x(), up.y(), up.z())};
  if (gaussians.metric) comments.push_back(kMetric);
  return comments;
}

SplatFile read_gaussian_ply(const std::filesystem::path& path) {
  if (is_compressed_ply(path)) return read_compressed_ply(path);
  SplatFile file;
  PlyHeader header;
  PointCloud cloud;
  bool points = false;
  read_ply(path, [&](const PlyHeader& found) {
    header = found;
    points = !header.find("f_dc_0");
    if (points) check_count(header.count, header.file);
    return points ? point_rows(header, cloud) : gaussian_rows(header, file.gaussians);
  });
  if (points) {
    file.gaussians = gaussians_from_points(cloud);
    file.warnings.push_back(text(path.string(), ": holds points without f_dc_0: they became round Gaussians"));
    if (cloud.count() < header.count) {
      file.warnings.push_back(text(path.string(), ": ", header.count - cloud.count(), " of ", header.count,
                                   " points left out: their positions are not finite"));
    }
  }
  take_comments(header.comments, file.gaussians);
  return file;
}

void write_gaussian_ply(const std::filesystem::path& path, const Gaussians& gaussians) {
  commit_stream(path, [&](const ByteSink& sink) { write_gaussian_ply(gaussians, sink); });
}

void write_gaussian_ply(const Gaussians& gaussians, const ByteSink& sink) {
  const std::size_t coefficients = rest_of_degree(degree_of(gaussians));
  const auto fill = [&](std::size_t g, std::span<float> row) {
    auto at = row.begin();
    const auto put = [&](const std::vector<float>& values, std::size_t width) {
      at = std::copy_n(values.begin() + static_cast<std::ptrdiff_t>(g * width), width, at);
    };
    put(gaussians.means, 3);
    at = std::fill_n(at, 3, 0.f);  // normals
    put(gaussians.sh_first, 3);
    for (std::size_t channel = 0; channel < 3; ++channel) {
      for (std::size_t k = 0; k < coefficients; ++k) {
        *at++ = gaussians.sh_rest[3 * (kSphericalRest * g + k) + channel];
      }
    }
    put(gaussians.opacities, 1);
    put(gaussians.scales, 3);
    put(gaussians.rotations, 4);
  };
  ply_rows(header_of(gaussians, coefficients), fill, sink);
}

}  // namespace cloam
