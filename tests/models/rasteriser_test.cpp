// The rasteriser against float64 brute force, against other programs' renders, and its gradients against differences.
#include <doctest/doctest.h>

#include <filesystem>
#include <map>
#include <random>

#include "models/io/safetensors.h"
#include "models/splat/draw.h"
#include "tests/models/folder.h"
#include "tests/models/splat_twin.h"

using namespace cloam;

namespace {

constexpr int kNumbers = 59;

Gaussians gaussians_of(const TwinRows& rows) {
  Gaussians g;
  for (const auto& row : rows) {
    const auto add = [&](std::vector<float>& to, int first, int count) {
      for (int k = 0; k < count; k++) to.push_back(static_cast<float>(row[first + k]));
    };
    add(g.means, 0, 3);
    add(g.scales, 3, 3);
    add(g.rotations, 6, 4);
    add(g.opacities, 10, 1);
    add(g.sh_first, 11, 3);
    add(g.sh_rest, 14, 45);
  }
  return g;
}

/// The numbers as float32 holds them: what both sides are given.
void round_to_float(TwinRows& rows) {
  for (auto& row : rows) row = row.cast<float>().cast<double>().eval();
}

TwinView view_of_tests(int width, int height) {
  TwinView view;
  view.camera.width = width, view.camera.height = height;
  view.camera.fx = 0.9 * width, view.camera.fy = 0.95 * width;
  view.camera.cx = 0.47 * width, view.camera.cy = 0.55 * height;
  const Eigen::Matrix3d turn = Eigen::AngleAxisd(0.3, Eigen::Vector3d(0.2, 1, -0.1).normalized()).toRotationMatrix();
  view.camera_from_world << turn, Eigen::Vector3d(0.1, -0.2, 4);
  view.camera_from_world = view.camera_from_world.cast<float>().cast<double>().eval();
  return view;
}

Tensor view_tensor(const TwinView& view, bool tracked) {
  std::vector<float> values;
  for (int r = 0; r < 3; r++)
    for (int c = 0; c < 4; c++) values.push_back(static_cast<float>(view.camera_from_world(r, c)));
  return tracked ? parameter(values, {3, 4}) : from_host(values, {3, 4});
}

TwinRows random_rows(int count, unsigned seed) {
  std::mt19937 generator(seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform;
  TwinRows rows(static_cast<size_t>(count));
  for (auto& row : rows) {
    for (int k = 0; k < 3; k++) row[k] = 1.6 * normal(generator);
    for (int k = 3; k < 6; k++) row[k] = -3.5 + 2.2 * uniform(generator);
    for (int k = 6; k < 10; k++) row[k] = normal(generator);
    row[10] = 2 * normal(generator);
    for (int k = 11; k < 14; k++) row[k] = normal(generator);
    for (int k = 14; k < kNumbers; k++) row[k] = 0.2 * normal(generator);
  }
  return rows;
}

/// [H,W,4] as twin_render.
std::vector<float> rasterised(const TwinRows& rows, const TwinView& view) {
  const Drawn drawn = draw(splat_model(gaussians_of(rows)), view.camera, view_tensor(view, false), {0.2f});
  const std::vector<float> planes = drawn.planes.to_host(), through = drawn.transmittance.to_host();
  std::vector<float> out;
  for (size_t i = 0; i < through.size(); i++) {
    for (size_t c = 0; c < 3; c++) out.push_back(planes[c * through.size() + i]);
    out.push_back(through[i]);
  }
  return out;
}

double largest_difference(const std::vector<float>& a, const std::vector<double>& b) {
  REQUIRE(a.size() == b.size());
  double most = 0;
  for (size_t i = 0; i < a.size(); i++) most = std::max(most, std::abs(double{a[i]} - b[i]));
  return most;
}

}  // namespace

TEST_CASE("rasteriser: 500 gaussians as brute force in float64 draws them") {
  TwinRows rows = random_rows(500, 3);
  const TwinView view = view_of_tests(75, 53);
  const Eigen::Matrix3d turn = view.camera_from_world.leftCols<3>();
  const auto at_depth = [&](size_t i, double x, double y, double z) {
    rows[i].segment<3>(0) = turn.transpose() * (Eigen::Vector3d(x, y, z) - view.camera_from_world.col(3));
  };
  for (size_t i = 0; i < 40; i++) rows[i].segment<3>(0) = rows[i - i % 4].segment<3>(0);          // ties in depth
  for (size_t i = 40; i < 80; i++) rows[i].segment<3>(3) = Eigen::Vector3d(-0.5, -7, -7.5);       // needles
  for (size_t i = 80; i < 100; i++) at_depth(i, 0.02 * static_cast<double>(i) - 1.8, 0.1, -0.5);  // behind
  for (size_t i = 100; i < 120; i++) at_depth(i, 0.01, -0.02, 0.19 + 0.001 * static_cast<double>(i - 100));
  for (size_t i = 100; i < 120; i++) rows[i][10] = -4;  // across the near plane, over the whole picture
  round_to_float(rows);
  const std::vector<double> wanted = twin_render(rows, view);
  CHECK(largest_difference(rasterised(rows, view), wanted) < 1e-4);
  CHECK(*std::min_element(wanted.begin(), wanted.end()) >= 0);
  TwinRows fewer(rows.begin(), rows.end() - 1);
  CHECK(largest_difference(rasterised(fewer, view), wanted) > 1e-2);  // one left out is seen
}

TEST_CASE("rasteriser: gradients of all 59 numbers and of the pose") {
  TwinRows rows = random_rows(6, 11);
  for (auto& row : rows) {
    row.segment<3>(0) *= 0.3;          // in the middle of the picture, one behind another
    row.segment<3>(3).array() += 1.2;  // wide: no pixel is near the edge of 1/255
    row[10] = std::clamp(row[10], -1.5, 1.0);
  }
  round_to_float(rows);
  TwinView view = view_of_tests(20, 17);
  std::mt19937 generator(5);
  std::normal_distribution<double> normal;
  std::vector<float> weights;
  for (int i = 0; i < 4 * 20 * 17; i++) weights.push_back(static_cast<float>(normal(generator)));
  const auto loss = [&](const TwinRows& of, const TwinView& from) {
    const std::vector<double> picture = twin_render(of, from);
    double sum = 0;
    for (size_t i = 0; i < picture.size(); i++) sum += picture[i] * double{weights[i]};
    return sum;
  };

  const SplatModel model = splat_model(gaussians_of(rows));
  const Tensor pose = view_tensor(view, true);
  const Drawn drawn = draw(model, view.camera, pose, {0.2f});
  const Tensor both = concat({permute(drawn.planes, {1, 2, 0}), unsqueeze(drawn.transmittance, 2)}, 2);
  const Tensors gradients = grad(sum(both * from_host(weights, {17, 20, 4})),
                                 {model.cloud.means, model.cloud.scales, model.cloud.rotations, model.cloud.opacities,
                                  model.harmonics.first, model.harmonics.rest, pose});
  const int widths[] = {3, 3, 4, 1, 3, 45};
  double worst = 0;
  int first = 0, far = 0;
  for (size_t part = 0; part < 6; first += widths[part++]) {
    const std::vector<float> found = gradients[part].to_host();
    double scale = 0;
    for (const float x : found) scale = std::max(scale, std::abs(double{x}));
    CHECK(scale > 0);
    for (size_t i = 0; i < rows.size(); i++) {
      for (int k = 0; k < widths[part]; k++) {
        TwinRows more = rows, less = rows;
        constexpr double kStep = 1e-5;
        more[i][first + k] += kStep, less[i][first + k] -= kStep;
        const double wanted = (loss(more, view) - loss(less, view)) / (2 * kStep);
        const double error =
            std::abs(double{found[i * static_cast<size_t>(widths[part]) + static_cast<size_t>(k)]} - wanted) / scale;
        worst = std::max(worst, error);
        far += error > 1e-3;
      }
    }
  }
  CHECK(far == 0);
  CHECK(worst < 1e-3);
  const std::vector<float> found = gradients[6].to_host();
  double scale = 0;
  for (const float x : found) scale = std::max(scale, std::abs(double{x}));
  for (int k = 0; k < 12; k++) {
    TwinView more = view, less = view;
    more.camera_from_world(k / 4, k % 4) += 1e-5, less.camera_from_world(k / 4, k % 4) -= 1e-5;
    const double wanted = (loss(rows, more) - loss(rows, less)) / 2e-5;
    CHECK(std::abs(double{found[static_cast<size_t>(k)]} - wanted) / scale < 1e-3);
  }
}

TEST_CASE("rasteriser: sums of absolute gradients of the means, pixel by pixel") {
  TwinRows rows = random_rows(3, 21);
  for (auto& row : rows) {
    row.segment<3>(0) *= 0.3;
    row.segment<3>(3).array() += 1.2;
    row[10] = std::clamp(row[10], -1.5, 1.0);
  }
  round_to_float(rows);
  const TwinView view = view_of_tests(20, 17);
  const SplatModel model = splat_model(gaussians_of(rows));
  DrawOptions options{0.2f};
  options.probe = parameter(std::vector<float>(6, 0), {3, 2});
  const Drawn drawn = draw(model, view.camera, view_tensor(view, false), options);
  const std::vector<float> found = grad(sum(drawn.planes), {options.probe}).front().to_host();
  for (size_t i = 0; i < 3; i++) {
    for (int axis = 0; axis < 2; axis++) {
      TwinView more = view, less = view;
      more.shifts.assign(3, Eigen::Vector2d::Zero());
      less.shifts = more.shifts;
      more.shifts[i][axis] = 1e-5, less.shifts[i][axis] = -1e-5;
      const std::vector<double> up = twin_render(rows, more), down = twin_render(rows, less);
      double wanted = 0, plain = 0;
      for (size_t p = 0; p < up.size(); p += 4) {
        double pixel = 0;
        for (size_t c = 0; c < 3; c++) pixel += (up[p + c] - down[p + c]) / 2e-5;
        wanted += std::abs(pixel);
        plain += pixel;
      }
      CHECK(found[2 * i + static_cast<size_t>(axis)] == doctest::Approx(wanted).epsilon(1e-3));
      CHECK(std::abs(plain) < 0.9 * wanted);  // the two are not the same here
    }
  }
}

TEST_CASE("rasteriser: the renders of another program") {
  const std::filesystem::path folder = test_data("gs_fixtures/brush");
  if (no_data(folder)) return;
  for (const char* name : {"tiny_case.safetensors", "basic_case.safetensors"}) {
    const SafetensorsFile file = read_safetensors(folder / name);
    const auto values = [&](const char* key) {
      const NamedTensor& t = file.tensors.at(key);
      const auto* begin = reinterpret_cast<const float*>(t.data.data());
      return std::vector<float>(begin, begin + t.data.size() / 4);
    };
    Gaussians g;
    g.means = values("means"), g.scales = values("scales"), g.rotations = values("quats");
    g.opacities = values("opacities");
    const std::vector<float> coefficients = values("coeffs"), wanted = values("out_img");
    for (size_t i = 0; i < coefficients.size(); i += 48) {
      const auto at = coefficients.begin() + static_cast<std::ptrdiff_t>(i);
      g.sh_first.insert(g.sh_first.end(), at, at + 3);
      g.sh_rest.insert(g.sh_rest.end(), at + 3, at + 48);
    }
    const NamedTensor& image = file.tensors.at("out_img");
    Camera camera;
    camera.height = static_cast<int>(image.shape[0]), camera.width = static_cast<int>(image.shape[1]);
    camera.fx = camera.fy = 0.5 * camera.width;  // 90 degrees across
    camera.cx = 0.5 * camera.width, camera.cy = 0.5 * camera.height;
    Eigen::Matrix4d world_from_camera = Eigen::Matrix4d::Identity();
    world_from_camera.block<3, 1>(0, 3) = Eigen::Vector3d(0.123, 0.456, -8);
    const Drawn drawn = draw(splat_model(g), camera, view_matrix(world_from_camera), {0.01f});
    const std::vector<float> planes = drawn.planes.to_host(), through = drawn.transmittance.to_host();
    size_t off = 0, seen = 0;
    for (size_t i = 0; i < through.size(); i++) {
      for (size_t c = 0; c < 4; c++) {
        const float value = c < 3 ? planes[c * through.size() + i] : 1 - through[i], want = wanted[4 * i + c];
        off += std::abs(value - want) > 1e-5f + 0.01f * std::abs(want);
        seen += want > 0.05f;
      }
    }
    CHECK_MESSAGE(off == 0, name, ": ", off, " of ", 4 * through.size(), " values differ");
    CHECK(seen > 100);
  }
}
