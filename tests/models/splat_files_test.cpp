// Files of gaussians: bytes written by hand from the formats' definitions, files that other programs made, and damage.
#include <doctest/doctest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <random>

#include "models/gaussians/formats.h"
#include "models/gaussians/spz.h"
#include "models/gaussians/turn.h"
#include "models/io/gzip.h"
#include "runtime/error.h"
#include "tests/models/errors.h"
#include "tests/models/folder.h"
#include "tests/models/invented_gaussians.h"

namespace fs = std::filesystem;
using namespace cloam;
using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

void write(const fs::path& path, const std::string& content) {
  std::ofstream(path, std::ios::binary | std::ios::trunc) << content;
}

template <class... Values>
std::string bytes_of(Values... values) {
  std::string bytes;
  (bytes.append(reinterpret_cast<const char*>(&values), sizeof values), ...);
  return bytes;
}

std::string gzipped(const std::string& content) {
  const auto bytes = gzip({reinterpret_cast<const std::uint8_t*>(content.data()), content.size()});
  return {bytes.begin(), bytes.end()};
}

Matrix3d covariance(const Gaussians& g, std::size_t i) {
  const float* q = &g.rotations[4 * i];
  const Matrix3d rotation = Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized().toRotationMatrix();
  const Vector3d scale = Eigen::Map<const Eigen::Vector3f>(&g.scales[3 * i]).cast<double>().array().exp();
  return rotation * scale.cwiseAbs2().asDiagonal() * rotation.transpose();
}

// Kerbl et al.'s colour, with the constants of their code.
double colour(const Gaussians& g, std::size_t i, int channel, const Vector3d& d) {
  const double x = d.x(), y = d.y(), z = d.z(), xx = x * x, yy = y * y, zz = z * z;
  const double basis[] = {-0.4886025119029199 * y,
                          0.4886025119029199 * z,
                          -0.4886025119029199 * x,
                          1.0925484305920792 * x * y,
                          -1.0925484305920792 * y * z,
                          0.31539156525252005 * (2 * zz - xx - yy),
                          -1.0925484305920792 * x * z,
                          0.5462742152960396 * (xx - yy),
                          -0.5900435899266435 * y * (3 * xx - yy),
                          2.890611442640554 * x * y * z,
                          -0.4570457994644658 * y * (4 * zz - xx - yy),
                          0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy),
                          -0.4570457994644658 * x * (4 * zz - xx - yy),
                          1.445305721320277 * z * (xx - yy),
                          -0.5900435899266435 * x * (xx - 3 * yy)};
  double sum = 0.5 + 0.28209479177387814 * double(g.sh_first[3 * i + std::size_t(channel)]);
  for (std::size_t k = 0; k < 15; ++k) sum += basis[k] * double(g.sh_rest[45 * i + 3 * k + std::size_t(channel)]);
  return sum;
}

std::string ply_header(const std::string& lines, int count) {
  return "ply\nformat binary_little_endian 1.0\nelement vertex " + std::to_string(count) + "\n" + lines +
         "end_header\n";
}

std::string floats(const std::vector<std::string>& names) {
  std::string lines;
  for (const std::string& name : names) lines += "property float " + name + "\n";
  return lines;
}

const char* const kEverything[] = {"ply", "splat", "spz", "glb", "compressed.ply"};

}  // namespace

TEST_CASE("splat .ply: every bit comes back, with the up axis and the unit") {
  const Folder folder;
  for (int degree = 0; degree <= 3; ++degree) {
    Gaussians given = invented(700, degree);
    given.rotations[5] = -0.f;
    given.opacities[3] = std::numeric_limits<float>::denorm_min();
    given.up = Vector3d(0.1, -0.7, 1.0 / 3);
    given.metric = degree == 2;
    write_gaussians(folder.path / "a.ply", given);
    const SplatFile found = read_gaussians(folder.path / "a.ply");
    CHECK(found.warnings.empty());
    const auto same = [](const std::vector<float>& a, const std::vector<float>& b) {
      return a.size() == b.size() && std::memcmp(a.data(), b.data(), 4 * a.size()) == 0;
    };
    CHECK(same(found.gaussians.means, given.means));
    CHECK(same(found.gaussians.scales, given.scales));
    CHECK(same(found.gaussians.rotations, given.rotations));
    CHECK(same(found.gaussians.opacities, given.opacities));
    CHECK(same(found.gaussians.sh_first, given.sh_first));
    CHECK(same(found.gaussians.sh_rest, given.sh_rest));
    CHECK(found.gaussians.up == given.up);
    CHECK(found.gaussians.metric == given.metric);
    const int columns = 17 + 3 * ((degree + 1) * (degree + 1) - 1);
    const std::string content = content_of(folder.path / "a.ply");
    CHECK(content.size() - content.find("end_header\n") - 11 == std::size_t(700 * 4 * columns));
  }
}

TEST_CASE("splat .ply: the columns may stand in any order, and f_rest is channel after channel") {
  const Folder folder;
  std::vector<std::string> names = {"rot_3", "rot_2", "rot_1", "rot_0", "opacity", "extra"};
  for (int i = 8; i >= 0; --i) names.push_back("f_rest_" + std::to_string(i));
  for (const char* name : {"f_dc_0", "f_dc_1", "f_dc_2", "scale_2", "scale_0", "scale_1", "z", "y", "x"})
    names.push_back(name);
  std::string vertex;
  for (std::size_t i = 0; i < names.size(); ++i) vertex += bytes_of(float(i));
  write(folder.path / "a.ply", ply_header(floats(names), 1) + vertex);
  const Gaussians g = read_gaussians(folder.path / "a.ply").gaussians;
  const auto value = [&](const std::string& name) {
    return float(std::find(names.begin(), names.end(), name) - names.begin());
  };
  CHECK(g.means == std::vector<float>{value("x"), value("y"), value("z")});
  CHECK(g.scales == std::vector<float>{value("scale_0"), value("scale_1"), value("scale_2")});
  CHECK(g.rotations == std::vector<float>{value("rot_0"), value("rot_1"), value("rot_2"), value("rot_3")});
  CHECK(g.opacities[0] == value("opacity"));
  CHECK(g.sh_first == std::vector<float>{value("f_dc_0"), value("f_dc_1"), value("f_dc_2")});
  // Of degree 1: coefficients 0 to 2 of red, then of green, then of blue.
  for (std::size_t k = 0; k < 3; ++k) {
    for (std::size_t c = 0; c < 3; ++c) CHECK(g.sh_rest[3 * k + c] == value("f_rest_" + std::to_string(3 * c + k)));
  }
  CHECK(g.sh_rest[9] == 0);
  CHECK(g.up == Vector3d(0, -1, 0));
  CHECK_FALSE(g.metric);
}

TEST_CASE("splat .ply: clouds of points become gaussians") {
  const Folder folder;
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const std::string colours = "property uchar red\nproperty uchar green\nproperty uchar blue\n";
  write(folder.path / "a.ply", ply_header(floats({"x", "y", "z"}) + colours, 3) + bytes_of(0.f, 0.f, 0.f) + "\xff" +
                                   std::string(2, '\0') + bytes_of(nan, 0.f, 0.f) + "abc" + bytes_of(3.f, 4.f, 0.f) +
                                   "\x80\x80\x80");
  const SplatFile file = read_gaussians(folder.path / "a.ply");
  REQUIRE(file.gaussians.count() == 2);
  CHECK(file.warnings.size() == 2);
  CHECK(holds(file.warnings[1], "1 of 3 points left out"));
  CHECK(file.gaussians.scales[0] == doctest::Approx(std::log(5.0)));
  CHECK(file.gaussians.sh_first[0] == doctest::Approx(0.5 / 0.28209479177387814));
  CHECK(file.gaussians.sh_first[1] == doctest::Approx(-0.5 / 0.28209479177387814));
  write(folder.path / "b.ply", "ply\nformat ascii 1.0\ncomment up 0 0 1\ncomment unit metre\nelement vertex 2\n" +
                                   floats({"x", "y", "z", "red", "green", "blue"}) +
                                   "end_header\n0 0 0 1 0.5 0\n0 0 2 0 0 0\n");
  const Gaussians g = read_gaussians(folder.path / "b.ply").gaussians;
  CHECK(g.sh_first[0] == doctest::Approx(0.5 / 0.28209479177387814));
  CHECK(g.up == Vector3d(0, 0, 1));
  CHECK(g.metric);
  write(folder.path / "c.ply",
        "ply\nformat ascii 1.0\nelement vertex 1\n" + floats({"x", "y", "z"}) + "end_header\n1 2 3\n");
  CHECK(std::abs(read_gaussians(folder.path / "c.ply").gaussians.sh_first[2]) < 0.01);
}

TEST_CASE("splat files: 32 bytes a gaussian, from the definition of .splat") {
  const Folder folder;
  const std::string record =
      bytes_of(1.f, -2.f, 3.f, 0.5f, 2.f, 1.f) + std::string("\xff\x00\x80\xcc\x80\xc0\x40\xff", 8);
  write(folder.path / "a.splat", record);
  const Gaussians g = read_gaussians(folder.path / "a.splat").gaussians;
  CHECK(g.means == std::vector<float>{1, -2, 3});
  CHECK(g.scales[0] == doctest::Approx(std::log(0.5)));
  CHECK(g.opacities[0] == doctest::Approx(std::log(0.8 / 0.2)));
  CHECK(g.rotations == std::vector<float>{0, 0.5f, -0.5f, 127.f / 128});
  CHECK(0.5 + 0.28209479177387814 * double(g.sh_first[0]) == doctest::Approx(1));
  CHECK(g.up == Vector3d(0, -1, 0));
  write(folder.path / "b.splat", record + record);
  CHECK(read_gaussians(folder.path / "b.splat").gaussians.count() == 2);
  write(folder.path / "c.splat", "");
  CHECK(holds(error_of([&] { read_gaussians(folder.path / "c.splat"); }), "holds 0 bytes"));
  // Opacities of 0 and 255 and deviations of 0 have no logarithm, and come back as the same bytes.
  write(folder.path / "d.splat", bytes_of(0.f, 0.f, 0.f, 0.f, 1.f, 1.f) + std::string("\0\0\0\xff\xff\x80\x80\x80", 8) +
                                     bytes_of(0.f, 0.f, 0.f, 1.f, 1.f, 1.f) +
                                     std::string("\0\0\0\0\xff\x80\x80\x80", 8));
  write_gaussians(folder.path / "e.splat", read_gaussians(folder.path / "d.splat").gaussians);
  const std::string again = content_of(folder.path / "e.splat");
  CHECK(again.substr(24, 8) == std::string("\0\0\0\xff\xff\x80\x80\x80", 8));
  CHECK(again.substr(56, 8) == std::string("\0\0\0\0\xff\x80\x80\x80", 8));
}

TEST_CASE("splat files: .spz of versions 2 and 3 from the definition") {
  const Folder folder;
  // A gaussian of degree 1 with 8 bits after the point, half a turn about an axis between x and z.
  const auto file = [](std::uint8_t version, const std::string& rotation) {
    std::string content =
        "NGSP" + bytes_of(std::uint32_t{version}, std::uint32_t{1}) + std::string("\x01\x08\x00\x00", 4);
    content += std::string("\x00\x01\x00\x80\xff\xff\xff\xff\x7f", 9);  // 1, -0.5, (2^23 - 1) / 256
    content += std::string("\x33\x00\x80\xff\xa0\x90\x00", 7);          // 0.2; colours; deviations e^0, e^-1, e^-10
    return gzipped(content + rotation + std::string("\x80\x00\xff\x90\xa0\xb0\x80\x80\x80", 9));
  };
  const double half = std::sqrt(0.5);
  // In the third version w and y are 0, the larger of x and z (here equal: x) is left out, z is sqrt(1/2), 511 / 511.
  const std::string third = bytes_of(std::uint32_t{0u << 30 | 0u << 20 | 511u << 10 | 0u});
  const std::string second("\xda\x80\xda", 3);  // 127.5 + 127.5 * 0.7098
  for (const int version : {2, 3}) {
    write(folder.path / "a.spz", file(std::uint8_t(version), version == 2 ? second : third));
    const SplatFile read = read_gaussians(folder.path / "a.spz");
    const Gaussians& g = read.gaussians;
    CHECK(read.warnings.empty());
    CHECK(g.means == std::vector<float>{1, -0.5, 32767.996f});
    CHECK(g.opacities[0] == doctest::Approx(std::log(0.2 / 0.8)));
    CHECK(g.sh_first[0] == doctest::Approx(-0.5 / 0.15));
    CHECK(g.sh_first[2] == doctest::Approx(0.5 / 0.15));
    CHECK(g.scales == std::vector<float>{0, -1, -10});
    CHECK(g.rotations[0] == doctest::Approx(0).epsilon(1e-3));
    CHECK(std::abs(double(g.rotations[1]) - half) < 0.01);
    CHECK(std::abs(double(g.rotations[2])) < 0.01);
    CHECK(std::abs(double(g.rotations[3]) - half) < 0.01);
    CHECK(std::vector<float>(g.sh_rest.begin(), g.sh_rest.begin() + 10) ==
          std::vector<float>{0, -1, 127.f / 128, 0.125, 0.25, 0.375, 0, 0, 0, 0});
    CHECK(g.up == Vector3d(0, 1, 0));
  }
}

TEST_CASE("splat files: what each format keeps") {
  struct Bounds {
    const char* file;
    SplatErrors most;
  };
  // Half a step of each quantity. Opacities: 1/510. Colours: .splat 1/510 within 0 and 1, .spz C0 / (2 * 0.15 * 255).
  // Compressed .ply: of a chunk as wide as all of them, 40 units, 8 logarithms, 0.96 of a colour.
  const Bounds all[] = {
      {"a.ply", {}},
      {"a.glb", {2e-6, 2e-6, 1e-3, 1e-6, 1e-6, 1e-5}},
      {"a.spz", {1.0 / 131072 + 1e-6, std::exp(1.0 / 32) - 1 + 1e-6, 0.25, 1.0 / 510 + 1e-6, 0.0037, 0.0626}},
      {"a.compressed.ply", {20.0 / 1023, std::expm1(4.0 / 1023), 0.3, 1.0 / 510 + 1e-6, 0.48 / 255, 1.0 / 64 + 1e-6}},
      {"a.splat", {2e-6, 2e-6, 1.1, 1.0 / 510 + 1e-6, 1.0 / 510 + 1e-6, 10}},
  };
  const Folder folder;
  for (const Vector3d& up : {Vector3d(0, 0, 1), Vector3d(0, -1, 0), Vector3d(0, 1, 0), Vector3d(1, 2, -3)}) {
    Gaussians given = invented(300, 3);
    for (float& value : given.sh_first) value = std::clamp(value, -1.7f, 1.7f);
    for (float& value : given.sh_rest) value = std::clamp(value, -0.5f, 0.5f);
    given.up = up;
    for (const auto& [name, most] : all) {
      CAPTURE(name);
      write_gaussians(folder.path / name, given);
      const SplatErrors found = reread_errors(folder.path / name, given);
      CHECK(found.position <= most.position);
      CHECK(found.scale <= most.scale);
      CHECK(found.rotation <= most.rotation);
      CHECK(found.opacity <= most.opacity);
      CHECK(found.colour <= most.colour);
      CHECK(found.harmonics <= most.harmonics);
    }
    write_spz(folder.path / "b.spz", given, 2);
    // Near w = 0, w is the root of twice a sum of three half steps: 2 asin(sqrt(2 * sqrt(3) / 255)).
    CHECK(reread_errors(folder.path / "b.spz", given).rotation < 13.4);
  }
}

TEST_CASE("splat files: written again, nothing changes") {
  const Folder folder;
  for (const char* extension : kEverything) {
    CAPTURE(extension);
    const fs::path first = folder.path / (std::string("a.") + extension),
                   again = folder.path / (std::string("b.") + extension);
    write_gaussians(first, invented(100, 3));
    write_gaussians(again, read_gaussians(first).gaussians);
    const SplatErrors errors = reread_errors(again, read_gaussians(first).gaussians);
    CHECK(errors.position == 0);
    CHECK(errors.scale < 1e-6);
    CHECK(errors.opacity < 1e-6);
    CHECK(errors.colour == 0);
    CHECK(errors.harmonics == 0);
    CHECK(errors.rotation < 0.15);
  }
}

TEST_CASE("splat: a turned scene is the same scene from the same side") {
  const Gaussians given = invented(20, 3);
  for (const Vector3d& up : {Vector3d(0, 1, 0), Vector3d(0, 0, -1), Vector3d(1, -2, 0.5)}) {
    const Gaussians found = turned(given, up);
    CHECK(found.up == up);
    // The rotation, from three means.
    Matrix3d before, after;
    for (int i = 0; i < 3; ++i) {
      before.col(i) = Eigen::Map<const Eigen::Vector3f>(&given.means[3 * std::size_t(i)]).cast<double>();
      after.col(i) = Eigen::Map<const Eigen::Vector3f>(&found.means[3 * std::size_t(i)]).cast<double>();
    }
    const Matrix3d rotation = after * before.inverse();
    CHECK(rotation.determinant() == doctest::Approx(1));
    CHECK((rotation * given.up - up.normalized()).norm() < 1e-5);
    for (std::size_t g = 0; g < given.count(); ++g) {
      const Vector3d d = Vector3d(std::sin(double(g)), std::cos(3.0 * double(g)), 0.3 * double(g) - 2).normalized();
      CHECK((rotation * covariance(given, g) * rotation.transpose() - covariance(found, g)).norm() < 1e-6);
      for (int c = 0; c < 3; ++c) CHECK(std::abs(colour(given, g, c, d) - colour(found, g, c, rotation * d)) < 1e-5);
    }
  }
  // y down to y up leaves x, and the signs are exact.
  Gaussians down = given;
  down.up = Vector3d(0, -1, 0);
  const Gaussians turned_up = turned(down, Vector3d(0, 1, 0));
  CHECK(turned_up.means[0] == given.means[0]);
  CHECK(turned_up.means[1] == -given.means[1]);
  CHECK(turned_up.means[2] == -given.means[2]);
  for (std::size_t i = 0; i < 45; ++i) CHECK(std::abs(turned_up.sh_rest[i]) == std::abs(given.sh_rest[i]));
}

TEST_CASE("splat GLB: the document is glTF's, and nodes move what they hold") {
  const Folder folder;
  Gaussians given = invented(5, 1);
  given.up = Vector3d(0, 1, 0);
  given.metric = true;
  write_gaussians(folder.path / "a.glb", given);
  const std::string content = content_of(folder.path / "a.glb");
  std::uint32_t length;
  std::memcpy(&length, content.data() + 12, 4);
  auto json = nlohmann::json::parse(content.substr(20, length));
  CHECK(read_gaussians(folder.path / "a.glb").gaussians.metric);
  const auto& primitive = json["meshes"][0]["primitives"][0];
  CHECK(json["extensionsUsed"] == nlohmann::json::array({"KHR_gaussian_splatting"}));
  CHECK(primitive["mode"] == 0);
  CHECK(primitive["extensions"]["KHR_gaussian_splatting"]["kernel"] == "ellipse");
  CHECK(primitive["extensions"]["KHR_gaussian_splatting"]["colorSpace"] == "srgb_rec709_display");
  CHECK(primitive["attributes"].size() == 9);  // with COLOR_0 and three coefficients of degree 1
  const std::size_t bin = 20 + length + 8;
  const auto value_of = [&](const std::string& name, std::size_t index) {
    const auto& accessor = json["accessors"][primitive["attributes"][name].get<std::size_t>()];
    CHECK(accessor["componentType"] == 5126);
    const auto& view = json["bufferViews"][accessor["bufferView"].get<std::size_t>()];
    float value;
    std::memcpy(&value, content.data() + bin + view["byteOffset"].get<std::size_t>() + 4 * index, 4);
    return value;
  };
  CHECK(value_of("POSITION", 4) == given.means[4]);
  CHECK(value_of("KHR_gaussian_splatting:SCALE", 4) == doctest::Approx(std::exp(given.scales[4])));
  CHECK(value_of("KHR_gaussian_splatting:OPACITY", 4) == doctest::Approx(1 / (1 + std::exp(-given.opacities[4]))));
  CHECK(value_of("KHR_gaussian_splatting:SH_DEGREE_1_COEF_2", 4) == given.sh_rest[45 + 3 * 2 + 1]);
  const float length_of_first = std::hypot(std::hypot(given.rotations[0], given.rotations[1]),
                                           std::hypot(given.rotations[2], given.rotations[3]));
  CHECK(value_of("KHR_gaussian_splatting:ROTATION", 3) == doctest::Approx(given.rotations[0] / length_of_first));
  CHECK(value_of("KHR_gaussian_splatting:ROTATION", 0) == doctest::Approx(given.rotations[1] / length_of_first));

  const auto with_node = [&](const nlohmann::json& node) {
    json["nodes"][0] = node;
    std::string text = json.dump();
    text.resize((text.size() + 3) / 4 * 4, ' ');
    const std::string rest = content.substr(20 + length);
    write(folder.path / "b.glb",
          "glTF" +
              bytes_of(std::uint32_t{2}, std::uint32_t(20 + text.size() + rest.size()), std::uint32_t(text.size())) +
              "JSON" + text + rest);
    return read_gaussians(folder.path / "b.glb").gaussians;
  };
  // Half a turn about y, twice as large, one up.
  const Gaussians moved =
      with_node({{"mesh", 0}, {"rotation", {0, 1, 0, 0}}, {"scale", {2, 2, 2}}, {"translation", {0, 1, 0}}});
  CHECK(moved.means[0] == doctest::Approx(-2 * given.means[0]));
  CHECK(moved.means[1] == doctest::Approx(2 * given.means[1] + 1));
  CHECK(moved.means[2] == doctest::Approx(-2 * given.means[2]));
  CHECK(moved.scales[0] == doctest::Approx(given.scales[0] + std::log(2)));
  CHECK(moved.up == Vector3d(0, 1, 0));
  CHECK(holds(error_of([&] { with_node({{"mesh", 0}, {"scale", {1, 2, 1}}}); }), "unevenly"));
  CHECK(holds(error_of([&] { with_node({{"mesh", 0}, {"children", {0}}}); }), "appears twice"));
  CHECK(holds(error_of([&] { with_node({{"mesh", 7}}); }), "meshes 7 does not exist: there are 1"));
  json["meshes"][0]["primitives"][0].erase("extensions");
  CHECK(holds(error_of([&] { with_node({{"mesh", 0}}); }), "looked for a mesh with KHR_gaussian_splatting"));
}

TEST_CASE("splat files: gaussians that are not finite are left out, and said so") {
  const Folder folder;
  Gaussians given = invented(6, 3);
  given.means[0] = std::numeric_limits<float>::quiet_NaN();
  given.sh_rest[45 + 44] = std::numeric_limits<float>::infinity();
  given.scales[3 * 2] = 100;  // e^100 is no float
  std::fill_n(&given.rotations[4 * 3], 4, 0.f);
  write_gaussians(folder.path / "a.ply", given);
  const SplatFile file = read_gaussians(folder.path / "a.ply");
  REQUIRE(file.warnings.size() == 1);
  CHECK(holds(file.warnings[0], "4 of 6 Gaussians left out"));
  CHECK(file.gaussians.count() == 2);
  CHECK(file.gaussians.means[0] == given.means[12]);
  CHECK(file.gaussians.sh_rest[45] == given.sh_rest[5 * 45]);
  CHECK(holds(error_of([&] { reread_errors(folder.path / "a.ply", given); }, Fault::verification), "2 are read back"));
}

TEST_CASE("splat files: foreign ones are named") {
  const Folder folder;
  const auto error_for = [&](const std::string& name, const std::string& content, Fault fault = Fault::data) {
    write(folder.path / name, content);
    return error_of([&] { read_gaussians(folder.path / name); }, fault);
  };
  const std::string head = "NGSP" + bytes_of(std::uint32_t{4}, std::uint32_t{1}) + std::string(20, '\0');
  CHECK(holds(error_for("a.spz", head), "is .spz version 4"));
  CHECK(holds(error_for("b.spz", gzipped("PGSN")), "ends in the middle of the header"));
  CHECK(holds(error_for("c.spz", gzipped("XGSP" + head.substr(4))), "does not begin with NGSP"));
  const std::string huge = "NGSP" + bytes_of(std::uint32_t{3}, std::uint32_t{4000000000u}) + std::string(40, '\0');
  CHECK(holds(error_for("d.spz", gzipped(huge)), "4000000000 Gaussians of 20 bytes are declared, 36 bytes follow"));
  CHECK(holds(error_for("a.ksplat", "anything"), ".ksplat is not supported"));
  CHECK(holds(error_for("a.obj", "anything", Fault::usage), ".ply, .splat, .spz, .glb"));
  CHECK(holds(error_for("a.glb", "glTF" + bytes_of(std::uint32_t{1}, std::uint32_t{12})), "glTF of version 1"));
  CHECK(holds(error_for("a.ply", ply_header(floats({"x", "y", "z", "f_dc_0"}), 0)), "no property f_dc_1"));
  CHECK(holds(error_for("b.ply", ply_header(floats({"x", "y", "z"}), 0)), "holds no Gaussians"));
  CHECK(holds(error_of([&] { write_gaussians(folder.path / "a.ksplat", invented(1, 0)); }, Fault::usage),
              "cannot be written"));
  Gaussians far = invented(1, 0);
  far.means[1] = 1e8f;
  CHECK(holds(error_of([&] { write_gaussians(folder.path / "far.spz", far); }), "lies at 1"));
  CHECK_FALSE(fs::exists(folder.path / "far.spz"));
}

TEST_CASE("splat files: cut anywhere they are errors, with any byte changed never more") {
  const Folder folder;
  std::vector<fs::path> files;
  for (const char* extension : kEverything) {
    files.push_back(folder.path / (std::string("a.") + extension));
    write_gaussians(files.back(), invented(3, 1));
  }
  if (!no_data(test_data("gs_fixtures"))) {
    for (const char* name :
         {"schwa/test-splat.3-points-from-train.ply", "schwa/OneSplat.splat", "splat-transform/minimal-raw.spz",
          "splat-transform/minimal-v2.spz", "splat-transform/minimal-v3.spz", "splat-transform/minimal.splat"}) {
      files.push_back(test_data("gs_fixtures") / name);
    }
  }
  std::mt19937 random(7);
  for (const fs::path& file : files) {
    CAPTURE(file.string());
    const std::string whole = content_of(file);
    const fs::path damaged = folder.path / ("damaged" + file.extension().string());
    for (std::size_t size = 0; size < whole.size(); ++size) {
      if (file.extension() == ".splat" && size % 32 == 0 && size > 0) continue;  // a shorter file
      write(damaged, whole.substr(0, size));
      CAPTURE(size);
      CHECK(holds(error_of([&] { read_gaussians(damaged); }), "damaged"));  // the file's name at least
    }
    for (int i = 0; i < 500; ++i) {
      std::string changed = whole;
      changed[random() % whole.size()] = static_cast<char>(random());
      write(damaged, changed);
      error_of([&] { read_gaussians(damaged); });  // no other exception, and no other fault
    }
  }
}

TEST_CASE("splat files: what other programs wrote") {
  if (no_data(test_data("gs_fixtures"))) return;
  const Folder folder;
  // Trained by INRIA's code: again the same bytes but for our comment.
  const fs::path trained = test_data("gs_fixtures") / "schwa/test-splat.3-points-from-train.ply";
  const SplatFile three = read_gaussians(trained);
  CHECK(three.warnings.empty());
  REQUIRE(three.gaussians.count() == 3);
  CHECK(three.gaussians.up == Vector3d(0, -1, 0));
  write_gaussians(folder.path / "a.ply", three.gaussians);
  std::string written = content_of(folder.path / "a.ply");
  const std::string comment = "comment up 0 -1 0\n";
  REQUIRE(holds(written, comment));
  written.erase(written.find(comment), comment.size());
  CHECK(written == content_of(trained));

  // One scene in three formats: 2 by 2 gaussians 1 apart, with deviations of 0.1.
  const auto read = [](const char* name) {
    return read_gaussians(test_data("gs_fixtures") / "splat-transform" / name).gaussians;
  };
  const Gaussians splat = read("minimal.splat"), second = read("minimal-v2.spz"), raw = read("minimal-raw.spz");
  // .spz has y up, .splat has y down; the tool that wrote the file of version 3 turned the scene.
  const Gaussians third = turned(read("minimal-v3.spz"), Vector3d(0, -1, 0));
  CHECK(raw.means == second.means);
  CHECK(raw.sh_first == second.sh_first);
  REQUIRE(splat.count() == 4);
  for (const Gaussians* other : {&second, &third}) {
    REQUIRE(other->count() == 4);
    // The other file was written by hand, and not turned.
    CHECK(other->means == splat.means);
    for (std::size_t i = 0; i < 12; ++i) CHECK(std::abs(other->scales[i] - splat.scales[i]) <= 1.f / 32);
    for (std::size_t i = 0; i < 4; ++i) {
      CHECK(other->opacities[i] == doctest::Approx(splat.opacities[i]));
      CHECK((covariance(*other, i) - covariance(splat, i)).norm() < 1e-3);
    }
  }
  for (std::size_t i = 0; i < 12; ++i)
    CHECK(std::abs(third.sh_first[i] - splat.sh_first[i]) < 0.5 / (0.15 * 255) + 0.01);
  const Gaussians one = read_gaussians(test_data("gs_fixtures") / "schwa/OneSplat.splat").gaussians;
  CHECK(one.count() == 1);
  CHECK(one.scales[2] == doctest::Approx(std::log(4.880865)));

  const auto refusal = [](const char* name) {
    return error_of([&] { read_gaussians(test_data("gs_fixtures") / "splat-transform" / name); });
  };
  CHECK(holds(refusal("minimal-v4.spz"), "is .spz version 4"));
  CHECK(holds(refusal("minimal.ksplat"), ".ksplat is not supported"));
}
