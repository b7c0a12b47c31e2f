// Zip-NeRF: each part against integrals, closed forms and differences in float64, and a short training.
#include <doctest/doctest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <random>

#include "models/fields/zip_field.h"
#include "models/methods/registry.h"
#include "models/methods/zipnerf_renderer.h"
#include "models/render/cones.h"
#include "models/render/picture_pixels.h"
#include "models/render/proposals.h"
#include "models/render/scene_frame.h"
#include "runtime/error.h"
#include "tests/models/mean_colour.h"
#include "tests/models/worlds.h"

using namespace cloam;

namespace {

using Numbers = std::vector<double>;

Tensor tensor_of(const Numbers& numbers, const Shape& shape) {
  return from_host(std::vector<float>(numbers.begin(), numbers.end()), shape);
}

/// A histogram of one ray: edges in [0,1] and masses, some of them 0.
struct DrawnHistogram {
  Numbers edges, weights;
  RayHistogram tensors() const {
    const auto n = static_cast<int64_t>(weights.size());
    return {tensor_of(edges, {1, n + 1}), parameter(std::vector<float>(weights.begin(), weights.end()), {1, n})};
  }
};
DrawnHistogram drawn(unsigned seed, size_t pieces) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(0, 1);
  DrawnHistogram out;
  for (size_t i = 0; i <= pieces; i++) out.edges.push_back(0.05 + 0.9 * uniform(random));
  std::sort(out.edges.begin(), out.edges.end());
  for (size_t i = 0; i < pieces; i++) out.weights.push_back(i % 3 == 0 ? 0 : uniform(random) / 4);
  return out;
}

/// The mass below p of the histogram spread over 2 `half`, by 2,000 places in each piece.
double mass_below(const DrawnHistogram& h, double half, double p) {
  constexpr int kPlaces = 2000;
  double mass = 0;
  for (size_t i = 0; i < h.weights.size(); i++)
    for (int k = 0; k < kPlaces; k++) {
      const double at = h.edges[i] + (h.edges[i + 1] - h.edges[i]) * (k + 0.5) / kPlaces;
      mass += h.weights[i] / kPlaces * std::clamp((p - at + half) / (2 * half), 0.0, 1.0);
    }
  return mass;
}

double interlevel_truth(const DrawnHistogram& truth, const DrawnHistogram& proposal, double half) {
  double loss = 0;
  for (size_t i = 0; i < proposal.weights.size(); i++) {
    const double wanted = mass_below(truth, half, proposal.edges[i + 1]) - mass_below(truth, half, proposal.edges[i]);
    loss += std::pow(std::max(0.0, wanted - proposal.weights[i]), 2) / (proposal.weights[i] + 1e-5);
  }
  return loss / static_cast<double>(proposal.weights.size());
}

double distortion_truth(const DrawnHistogram& h) {
  double loss = 0;
  const auto middle = [&](size_t i) { return (h.edges[i] + h.edges[i + 1]) / 2; };
  for (size_t i = 0; i < h.weights.size(); i++) {
    loss += h.weights[i] * h.weights[i] * (h.edges[i + 1] - h.edges[i]) / 3;
    for (size_t j = 0; j < h.weights.size(); j++) loss += h.weights[i] * h.weights[j] * std::abs(middle(i) - middle(j));
  }
  return loss;
}

/// The gradient of a loss by the weights against differences in float64.
void check_gradient(const DrawnHistogram& at, const std::function<Tensor(const RayHistogram&)>& loss,
                    const std::function<double(const DrawnHistogram&)>& truth) {
  const RayHistogram tensors = at.tensors();
  const std::vector<float> found = grad(loss(tensors), {tensors.weights}).front().to_host();
  for (size_t i = 0; i < at.weights.size(); i++) {
    DrawnHistogram more = at, less = at;
    more.weights[i] += 1e-6, less.weights[i] -= 1e-6;
    CHECK(double(found[i]) == doctest::Approx((truth(more) - truth(less)) / 2e-6).epsilon(2e-3));
  }
}

struct OneCone {
  Eigen::Vector3d origin{0.3, -0.2, 0.1}, way = Eigen::Vector3d(0.4, -0.5, -0.7).normalized();
  double radius = 0.05, begin = 1.2, end = 2.9;
  Cones cones() const {
    return {{tensor_of({origin.x(), origin.y(), origin.z()}, {1, 3}), tensor_of({way.x(), way.y(), way.z()}, {1, 3}),
             tensor_of({0, 9}, {1, 2})},
            tensor_of({radius}, {1})};
  }
  Tensor edges() const { return tensor_of({begin, end}, {1, 2}); }
  /// Of t^power over the frustum, whose slices' area grows as t^2.
  double mean_of(int power) const {
    const auto integral = [&](int n) { return (std::pow(end, n + 1) - std::pow(begin, n + 1)) / (n + 1); };
    return integral(2 + power) / integral(2);
  }
};

std::vector<Eigen::Vector3d> points_of(const Tensor& tensor) {
  const std::vector<float> numbers = tensor.to_host();
  std::vector<Eigen::Vector3d> points;
  for (size_t i = 0; i < numbers.size(); i += 3) points.emplace_back(numbers[i], numbers[i + 1], numbers[i + 2]);
  return points;
}

/// Trains on 20 views of 48x48; the mean PSNR of the four test views.
double test_figure(const Scene& scene, const Settings& settings, int64_t steps) {
  const Folder folder;
  auto method = configured("zipnerf", settings);
  method->build({scene}, 7);
  load_data(*method, scene, load_images(scene, Split::train));
  TrainOptions options;
  options.steps = steps;
  train({*method, folder.path / "ckpt", {}, nullptr, nullptr}, options, {});
  const Pixels test = load_images(scene, Split::test);
  double figure = 0;
  for (const FramePixels& frame : test.frames)
    figure += psnr(shown(*method,
                         {test.cameras[static_cast<size_t>(frame.camera)], scene.frames[frame.frame].world_from_camera})
                       .rgb,
                   on_white(frame)) /
              static_cast<double>(test.frames.size());
  return figure;
}

}  // namespace

TEST_CASE("zipnerf: six samples have the frustum's mean and variance along the ray and square distance from it") {
  const OneCone one;
  for (const double flip : {0.0, 1.0}) {
    const ConeSamples found =
        six_samples(one.cones(), one.edges(), {tensor_of({0.37}, {1, 1}), tensor_of({flip}, {1, 1})});
    const std::vector<Eigen::Vector3d> points = points_of(found.points);
    const std::vector<float> widths = found.widths.to_host();
    REQUIRE(points.size() == 6);
    double mean = 0, square = 0, aside = 0;
    for (size_t j = 0; j < 6; j++) {
      const Eigen::Vector3d from = points[j] - one.origin;
      const double t = from.dot(one.way), distance = (from - t * one.way).norm();
      mean += t / 6, square += t * t / 6, aside += distance * distance / 6;
      CHECK(distance == doctest::Approx(one.radius * t / std::sqrt(2.0)).epsilon(1e-4));
      CHECK(double(widths[j]) == doctest::Approx(0.5 * one.radius * t / std::sqrt(2.0)).epsilon(1e-4));
    }
    CHECK(mean == doctest::Approx(one.mean_of(1)).epsilon(1e-5));
    CHECK(square - mean * mean == doctest::Approx(one.mean_of(2) - std::pow(one.mean_of(1), 2)).epsilon(1e-4));
    // A disc of radius r has a mean square distance of r^2 / 2.
    CHECK(aside == doctest::Approx(one.radius * one.radius * one.mean_of(2) / 2).epsilon(1e-4));
  }
}

TEST_CASE("zipnerf: over all spins the samples' covariance is the frustum's") {
  const OneCone one;
  constexpr int kSpins = 24;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  Eigen::Matrix3d square = Eigen::Matrix3d::Zero();
  for (int i = 0; i < kSpins; i++)
    for (const Eigen::Vector3d& p :
         points_of(six_samples(one.cones(), one.edges(),
                               {tensor_of({double(i) / kSpins}, {1, 1}), tensor_of({double(i % 2)}, {1, 1})})
                       .points)) {
      const Eigen::Vector3d from = p - one.origin;
      mean += from / (6 * kSpins), square += from * from.transpose() / (6 * kSpins);
    }
  const Eigen::Matrix3d along = one.way * one.way.transpose();
  const double variance = one.mean_of(2) - std::pow(one.mean_of(1), 2);
  const Eigen::Matrix3d expected =
      variance * along + one.radius * one.radius * one.mean_of(2) / 4 * (Eigen::Matrix3d::Identity() - along);
  CHECK((mean - one.mean_of(1) * one.way).norm() < 1e-4);
  CHECK((square - mean * mean.transpose() - expected).norm() < 1e-4);
  // The six are nowhere in one line: each spin alone is near it, too.
  const std::vector<Eigen::Vector3d> still = points_of(six_samples(one.cones(), one.edges(), still_turn(1)).points);
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& p : still) centre += (p - one.origin) / 6;
  CHECK((centre - one.mean_of(1) * one.way).norm() < 0.2 * one.radius);
}

TEST_CASE("zipnerf: one sample is the frustum's mean, as wide as the frustum") {
  const OneCone one;
  const ConeSamples found = one_sample(one.cones(), one.edges());
  const Eigen::Vector3d expected = one.origin + one.mean_of(1) * one.way;
  CHECK((points_of(found.points).front() - expected).norm() < 1e-5);
  CHECK(double(found.widths.item()) == doctest::Approx(one.radius * one.mean_of(1) / 2).epsilon(1e-5));
}

TEST_CASE("zipnerf: the contraction goes back, and shrinks widths by the root of its volume") {
  const auto folded = [](const Eigen::Vector3d& p) {
    const double r = p.norm();
    return r <= 1 ? p : Eigen::Vector3d((2 - 1 / r) / r * p);
  };
  for (const Eigen::Vector3d& p : std::initializer_list<Eigen::Vector3d>{
           {0.3, -0.2, 0.5}, {0.9, 0.1, -0.8}, {-3, 2, 0.5}, {20, -35, 8}, {0, 0, 0}}) {
    const Tensor point = tensor_of({p.x(), p.y(), p.z()}, {1, 1, 1, 3});
    const ConeSamples found = contracted({point, tensor_of({1}, {1, 1, 1})});
    CHECK((points_of(found.points).front() - folded(p)).norm() < 1e-6);
    CHECK((points_of(uncontracted(found.points)).front() - p).norm() < 1e-5 * std::max(1.0, p.squaredNorm()));
    Eigen::Matrix3d jacobian;
    for (int k = 0; k < 3; k++) {
      const Eigen::Vector3d step = 1e-6 * std::max(1.0, p.norm()) * Eigen::Vector3d::Unit(k);
      jacobian.col(k) = (folded(p + step) - folded(p - step)) / (2 * step.norm());
    }
    CHECK(double(found.widths.item()) == doctest::Approx(std::cbrt(jacobian.determinant())).epsilon(1e-4));
  }
}

TEST_CASE("zipnerf: the ray warp is the power transformation, and goes back") {
  const RayWarp warp(tensor_of({0.05, 1000}, {1, 2}), true);
  const auto bent = [](double t) { return 2.5 / -1.5 * (std::pow(2 * t / 2.5 + 1, -1.5) - 1); };
  for (const double t : {0.05, 0.3, 2.0, 40.0, 900.0}) {
    const Tensor s = warp.normalised(tensor_of({t}, {1, 1}));
    CHECK(double(s.item()) == doctest::Approx((bent(t) - bent(0.05)) / (bent(1000) - bent(0.05))).epsilon(1e-5));
    CHECK(double(warp.distances(s).item()) == doctest::Approx(t).epsilon(t < 100 ? 1e-3 : 0.3));
  }
  const RayWarp even(tensor_of({2, 6}, {1, 2}), false);
  CHECK(even.distances(tensor_of({0.25}, {1, 1})).item() == doctest::Approx(3));
}

TEST_CASE("zipnerf: samples lie where the histogram's cumulative mass has their ranks") {
  const DrawnHistogram h = drawn(3, 9);
  double all = 0;
  for (const double w : h.weights) all += w + 1e-5;
  const auto quantile = [&](double rank) {
    double below = 0;
    for (size_t i = 0; i < h.weights.size(); i++) {
      const double share = (h.weights[i] + 1e-5) / all;
      if (rank <= below + share) return h.edges[i] + (h.edges[i + 1] - h.edges[i]) * (rank - below) / share;
      below += share;
    }
    return h.edges.back();
  };
  const Numbers ranks = {0.05, 0.2, 0.31, 0.5, 0.77, 0.96};
  const std::vector<float> found = resampled_edges(h.tensors(), tensor_of(ranks, {1, 6})).to_host();
  REQUIRE(found.size() == 7);
  for (size_t i = 1; i < 6; i++)
    CHECK(double(found[i]) == doctest::Approx((quantile(ranks[i - 1]) + quantile(ranks[i])) / 2).epsilon(1e-4));
  CHECK(double(found[0]) ==
        doctest::Approx(std::max(0.0, 1.5 * quantile(ranks[0]) - 0.5 * quantile(ranks[1]))).epsilon(1e-4));
}

TEST_CASE("zipnerf: blurred masses are those of the histogram spread out, summed place by place") {
  const DrawnHistogram h = drawn(1, 11);
  const Numbers at = {0, 0.08, 0.21, 0.34, 0.35, 0.6, 0.88, 1};
  for (const double half : {0.03, 0.003}) {
    const std::vector<float> found =
        blurred_masses(h.tensors(), tensor_of(at, {1, 8}), static_cast<float>(half)).to_host();
    for (size_t i = 0; i + 1 < at.size(); i++)
      CHECK(double(found[i]) ==
            doctest::Approx(mass_below(h, half, at[i + 1]) - mass_below(h, half, at[i])).epsilon(1e-3));
  }
}

TEST_CASE("zipnerf: the interlevel loss is never below 0, and 0 where the proposal agrees") {
  for (unsigned seed = 0; seed < 8; seed++) {
    const DrawnHistogram truth = drawn(seed, 12), proposal = drawn(seed + 100, 16);
    const double found = double(interlevel_loss(truth.tensors(), proposal.tensors(), 0.03f).item());
    CHECK(found >= 0);
    CHECK(found == doctest::Approx(interlevel_truth(truth, proposal, 0.03)).epsilon(1e-3));
    // The same histogram, blurred by next to nothing, and a proposal that is the blurred truth.
    DrawnHistogram even = truth;
    for (size_t i = 0; i <= even.weights.size(); i++) even.edges[i] = static_cast<double>(i) / 12;
    for (double& w : even.weights) w += 0.01;
    CHECK(double(interlevel_loss(even.tensors(), even.tensors(), 1e-6f).item()) < 1e-7);
    RayHistogram agrees = proposal.tensors();
    agrees.weights = blurred_masses(truth.tensors(), agrees.edges, 0.03f);
    CHECK(interlevel_loss(truth.tensors(), agrees, 0.03f).item() == 0);
  }
}

TEST_CASE("zipnerf: the gradients of both losses are those of differences in float64") {
  const DrawnHistogram truth = drawn(5, 10);
  DrawnHistogram proposal = drawn(6, 14);
  for (double& w : proposal.weights) w += 0.01;
  check_gradient(
      proposal, [&](const RayHistogram& h) { return interlevel_loss(truth.tensors(), h, 0.03f); },
      [&](const DrawnHistogram& h) { return interlevel_truth(truth, h, 0.03); });
  check_gradient(proposal, distortion_loss, distortion_truth);
  CHECK(double(distortion_loss(truth.tensors()).item()) == doctest::Approx(distortion_truth(truth)).epsilon(1e-4));
}

TEST_CASE("zipnerf: levels count by how much of a sample lies in a cell, and a sample is the mean of its places") {
  Params params;
  const HashGrid grid{3, 2, 12, 4, 64};
  const DownweightedGrid encode(Scope{params, "", 5}, grid);
  std::mt19937 random(4);
  std::uniform_real_distribution<double> uniform(0, 1);
  Numbers points, widths;
  for (int i = 0; i < 5 * 6; i++) {
    for (int k = 0; k < 3; k++) points.push_back(uniform(random));
    widths.push_back(0.001 + 0.05 * uniform(random));
  }
  const Tensor table = params.at("table"), wide = encode({tensor_of(points, {5, 6, 3}), tensor_of(widths, {5, 6})});
  const std::vector<float> found = wide.to_host(),
                           plain = HashGridEncoder(grid)(tensor_of(points, {30, 3}), table).to_host();
  const double cells[] = {4, 16, 64};
  for (size_t s = 0; s < 5; s++)
    for (size_t n = 0; n < 6; n++) {
      double expected = 0;
      for (size_t k = 0; k < 6; k++)
        expected += plain[(6 * s + k) * 6 + n] * std::erf(1 / (std::sqrt(8.0) * widths[6 * s + k] * cells[n / 2])) / 6;
      CHECK(1e4 * double(found[6 * s + n]) == doctest::Approx(1e4 * expected).epsilon(1e-4));  // tables begin at 1e-4
    }
  // It is linear in the table: the gradient of its sum, times the table, is the sum.
  const Tensor all = sum(wide), gradient = grad(all, {table}).front();
  CHECK(1e4 * double(sum(gradient * table).item()) == doctest::Approx(1e4 * double(all.item())).epsilon(1e-4));
}

TEST_CASE("zipnerf: the decay is the sum of the levels' mean squares") {
  Params params;
  const DownweightedGrid encode(Scope{params, "", 5}, {2, 1, 9, 4, 64});
  const std::vector<float> table = params.at("table").to_host();
  REQUIRE(table.size() == 1024);
  double first = 0, second = 0;  // 5^3 of 512 rows are read of the first
  for (size_t i = 0; i < 512; i++)
    first += double(table[i]) * table[i], second += double(table[512 + i]) * table[512 + i];
  CHECK(1e8 * double(encode.decay().item()) == doctest::Approx(1e8 * (first / 125 + second / 512)).epsilon(1e-4));
}

TEST_CASE("zipnerf: densities are the softplus or the exponential of the network's first output less one") {
  Params params;
  const HashGrid grid{1, 1, 4, 2, 2};
  const ZipDensity paper(Scope{params, "", 5} / "paper", grid, {4, 2}),
      steep(Scope{params, "", 5} / "steep", grid, {4, 2, true});
  const Numbers x = {-30, -2, 0.5, 1, 4};
  Numbers features;
  for (const double number : x) features.insert(features.end(), {number, 7});
  const Tensor both = tensor_of(features, {5, 2});
  const std::vector<float> soft = paper.density(both).to_host(), fast = steep.density(both).to_host();
  for (size_t i = 0; i < x.size(); i++) {
    CHECK(double(soft[i]) == doctest::Approx(std::log1p(std::exp(x[i] - 1))).epsilon(1e-5));
    CHECK(double(fast[i]) == doctest::Approx(std::exp(std::max(x[i] - 1, -15.0))).epsilon(1e-5));
  }
}

TEST_CASE("zipnerf: pixels' widths squared are the image's solid angle") {
  Camera camera;
  camera.width = 60, camera.height = 40;
  camera.fx = camera.fy = 50;
  camera.cx = 30, camera.cy = 20;
  double angle = 0;
  for (const float width : pixel_widths(unit_directions(camera), 60, 40)) angle += double(width) * width;
  const double a = 30.0 / 50, b = 20.0 / 50;  // of a rectangle seen head on
  CHECK(angle == doctest::Approx(4 * std::atan(a * b / std::sqrt(1 + a * a + b * b))).epsilon(0.02));
}

TEST_CASE("pictures are halved by means, depths by what is seen") {
  Picture picture;
  picture.width = picture.height = 2;
  picture.rgb = {0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 1};
  picture.opacity = {1, 0, 1, 0};
  picture.depth = {2, 9, 4, 9};
  const Picture half = halved(picture);
  CHECK(half.rgb == std::vector<float>{0.5f, 0.5f, 0.25f});
  CHECK(half.opacity == std::vector<float>{0.5f});
  CHECK(half.depth == std::vector<float>{3});
}

TEST_CASE("zipnerf: space is about as large as the path of a driving log, in any direction; elsewhere it stays") {
  const double side = std::numbers::sqrt3 / 2;
  for (const double turn : {0.0, 0.7}) {
    CAPTURE(turn);
    const Eigen::Matrix3d heading = Eigen::AngleAxisd(turn, Eigen::Vector3d::UnitY()).toRotationMatrix();
    Scene scene;
    scene.cameras = {{4, 2, 4, 4, 2, 1, CameraModel::pinhole, {}, 0, 0}};
    for (int step = 0; step <= 200; step++)  // 20 m ahead; one camera looks ahead, one 60 degrees to the right
      for (const bool right : {false, true}) {
        Eigen::Matrix3d look = Eigen::Matrix3d::Identity();
        if (right) look << 0.5, 0, side, 0, 1, 0, -side, 0, 0.5;
        Frame frame;
        frame.step = step;
        frame.world_from_camera.block<3, 3>(0, 0) = heading * look;
        frame.world_from_camera.block<3, 1>(0, 3) = heading * Eigen::Vector3d(0, 0, 0.1 * step);
        scene.frames.push_back(frame);
      }
    CHECK(fit_path(scene).scale == fit_scene(scene).scale);
    scene.is_log = true;
    CHECK(1 / fit_path(scene).scale == doctest::Approx(20).epsilon(0.01));
    CHECK(fit_path(scene).centre == fit_scene(scene).centre);
  }
}

TEST_CASE("zipnerf: presets take the path for the unit; runs of before, which do not say it, the viewing distance") {
  for (const char* name : {"zipnerf", "zipnerf-small"}) {
    const Preset& preset = find_preset(name);
    CHECK(std::ranges::count(preset.settings, std::pair<std::string, std::string>("space.unit", "path")) == 1);
  }
  CHECK(ZipNerfConfig().unit == "viewing");
}

TEST_CASE("zipnerf learns held-out views of a small scene") {
  const Folder folder;
  write_synthetic_scene(folder.path / "data", {20, 4, 48, 3});
  const Scene scene = read_scene(folder.path / "data");
  const double figure = test_figure(scene,
                                    {{"grid.levels", "4"},
                                     {"grid.log2_rows", "13"},
                                     {"grid.finest", "128"},
                                     {"field.width", "32"},
                                     {"field.bottleneck", "16"},
                                     {"field.colour_width", "32"},
                                     {"proposal1.levels", "3"},
                                     {"proposal1.finest", "64"},
                                     {"proposal2.levels", "3"},
                                     {"proposal2.finest", "64"},
                                     {"proposals.log2_rows", "12"},
                                     {"proposals.width", "16"},
                                     {"samples.proposal", "16"},
                                     {"samples.field", "12"},
                                     {"batch.rays", "256"},
                                     {"train.warm_up", "20"}},
                                    250);
  const double baseline = mean_colour_figure(scene);
  MESSAGE("psnr ", figure, ", mean colour ", baseline);
  CHECK(figure > baseline + 7);
}

TEST_CASE("zipnerf: settings that it cannot have are named") {
  for (const auto& [key, value] : Settings{{"sampling.multisamples", "3"},
                                           {"sampling.proposal_multisamples", "2"},
                                           {"sampling.pixel_rays", "2"},
                                           {"field.density", "relu"},
                                           {"space.unit", "metre"},
                                           {"train.loss", "l1"},
                                           {"background", "pink"}}) {
    const Settings settings = {{key, value}};
    CHECK_THROWS_WITH_AS(configured("zipnerf", settings)->build({Scene()}, 1), doctest::Contains(key.c_str()), Error);
  }
}
