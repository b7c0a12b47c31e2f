// Normalised device coordinates: against NeRF's closed form (appendix C) in float64, and what a training in them
// reaches.
#include <doctest/doctest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "models/data/load_images.h"
#include "models/data/read_scene.h"
#include "models/io/image.h"
#include "models/methods/registry.h"
#include "models/metrics/psnr.h"
#include "models/render/rays.h"
#include "models/scene/split.h"
#include "models/train/trainer.h"
#include "tests/models/errors.h"
#include "tests/models/folder.h"
#include "tests/models/forward_facing.h"
#include "tests/models/made_method.h"
#include "tests/models/mean_colour.h"

namespace fs = std::filesystem;
using namespace cloam;

namespace {

Scene read_made(const fs::path& folder, const ForwardFacing& made) {
  fs::create_directories(folder / "images");
  std::vector<double> numbers;
  for (std::size_t i = 0; i < made.seats.size(); ++i) {
    write_png(folder / "images" / (std::to_string(100 + i) + ".png"),
              {made.width, made.height, 3, made.photo(made.seats[i])});
    const std::vector<double> row = made.row(made.seats[i]);
    numbers.insert(numbers.end(), row.begin(), row.end());
  }
  write_text(folder / "poses_bounds.npy",
             npy_bytes("<f8", std::to_string(made.seats.size()) + ", 17", bytes_of_numbers<double>(numbers)));
  return read_scene(folder);
}

/// Of a row-major [R,3] tensor on the host.
Eigen::Vector3d row_of(const std::vector<float>& values, std::size_t row) {
  return {values[3 * row], values[3 * row + 1], values[3 * row + 2]};
}

}  // namespace

TEST_CASE("rays in NDC follow the paper's closed form, and their lengths give distances back") {
  const Folder folder;
  const ForwardFacing made(24, 3);
  const Scene scene = read_made(folder.path, made);
  const SceneFrame frame = fit_ndc(scene, 0);
  CHECK(frame.scale == doctest::Approx(1 / (0.75 * 2)));
  for (const std::size_t place : {std::size_t{0}, std::size_t{7}, std::size_t{19}}) {
    const Rays rays = view_rays({scene.cameras[0], scene.frames[place].world_from_camera}, frame, {}),
               path = ndc_rays(rays, frame);
    const std::vector<float> from = rays.origins.to_host(), ways = rays.directions.to_host();
    const std::vector<float> begin = path.origins.to_host(), along = path.directions.to_host(),
                             span = path.span.to_host();
    const std::size_t count = ways.size() / 3;
    std::vector<float> lengths(count);
    std::vector<double> distances(count);
    for (std::size_t i = 0; i < count; ++i) {
      // The paper's: a camera that looks along -z, planes at -n (n = 1) and infinity; o is moved to the near plane
      // first.
      const Eigen::Vector3d origin = row_of(from, i).cwiseProduct(Eigen::Vector3d(1, 1, -1)),
                            way = row_of(ways, i).cwiseProduct(Eigen::Vector3d(1, 1, -1));
      const double near = -(1 + origin.z()) / way.z();
      const Eigen::Vector3d o = origin + near * way;
      const double ax = -frame.widen.x(), ay = -frame.widen.y();
      const Eigen::Vector3d o_ndc(ax * o.x() / o.z(), ay * o.y() / o.z(), 1 + 2 / o.z());
      const Eigen::Vector3d d_ndc(ax * (way.x() / way.z() - o.x() / o.z()), ay * (way.y() / way.z() - o.y() / o.z()),
                                  -2 / o.z());
      CHECK((row_of(begin, i) - o_ndc).norm() < 2e-6);
      CHECK((row_of(along, i) - d_ndc.normalized()).norm() < 2e-6);
      CHECK(span[2 * i] == doctest::Approx(0).epsilon(1e-5));
      CHECK(span[2 * i + 1] == doctest::Approx(d_ndc.norm()).epsilon(1e-5));  // to the end: inside the box all the way
      // A point of the ray at t from the near plane is at t' = 1 - o_z / (o_z + t d_z) (appendix C, eq. 10).
      const double t = 0.2 + 0.1 * static_cast<double>(i % 40), t_ndc = 1 - o.z() / (o.z() + t * way.z());
      lengths[i] = static_cast<float>(t_ndc * d_ndc.norm());
      distances[i] = near + t;
    }
    const std::vector<float> back =
        ndc_distances(rays, frame, from_host(lengths, {static_cast<int64_t>(count)})).to_host();
    for (std::size_t i = 0; i < count; ++i) CHECK(back[i] == doctest::Approx(distances[i]).epsilon(1e-4));
  }
}

TEST_CASE("rays in NDC: cameras beyond the near plane begin where they are, and those that look back see nothing") {
  SceneFrame frame;
  frame.ndc = true;
  const Rays rays{from_host(std::vector<float>{0.2f, 0.f, 3.f, 0.f, 0.f, 0.f}, {2, 3}),
                  from_host(std::vector<float>{0.f, 0.f, 1.f, 0.f, 0.6f, -0.8f}, {2, 3}),
                  from_host(std::vector<float>{0.f, 9.f, 0.f, 9.f}, {2, 2})};
  const Rays path = ndc_rays(rays, frame);
  const std::vector<float> begin = path.origins.to_host(), span = path.span.to_host();
  CHECK(begin[0] == doctest::Approx(0.2 / 3));
  CHECK(begin[2] == doctest::Approx(1 - 2.0 / 3));
  CHECK(span[1] > span[0]);
  CHECK(span[3] < span[2]);
}

TEST_CASE("NDC is refused where it cannot be, with the way out") {
  const Folder folder;
  Scene scene = read_made(folder.path, ForwardFacing(12, 1));
  scene.hints.nearest = {};
  CHECK(holds(error_of([&] { fit_ndc(scene, 0); }, Fault::usage), "--set space.nearest=DISTANCE"));
  CHECK(fit_ndc(scene, 4).scale == doctest::Approx(1 / 3.0));
  CHECK_FALSE(fits_ndc(scene));
  scene.hints.nearest = 4;
  CHECK(fits_ndc(scene));
  scene.frames[3].world_from_camera.block<3, 2>(0, 0) *= -1;
  scene.frames[3].world_from_camera.col(0).swap(scene.frames[3].world_from_camera.col(2));
  scene.frames[3].world_from_camera.col(0) *= -1;
  CHECK(holds(error_of([&] { fit_ndc(scene, 4); }, Fault::usage), "images/103.png looks too far to the side"));
  CHECK_FALSE(fits_ndc(scene));
  const auto configure = [] { (void)configured("nerf", {{"space.kind", "round"}}); };
  CHECK(holds(error_of(configure, Fault::usage), "want auto, contract or ndc"));
}

TEST_CASE("nerf in NDC learns held-out views of a forward-facing capture") {
  const Folder folder;
  const ForwardFacing made;
  Scene scene = read_made(folder.path, made);
  apply_holdout(scene, 8);
  Settings settings = small_hash();
  settings.emplace_back("space.kind", "auto");
  auto method = configured("nerf", settings);
  method->build({scene}, 7);
  load_data(*method, scene, load_images(scene, Split::train));
  TrainOptions options;
  options.steps = 300;
  train({*method, folder.path / "ckpt", {}, nullptr, nullptr}, options, {});
  const Pixels test = load_images(scene, Split::test);
  double sum = 0;
  for (const FramePixels& frame : test.frames) {
    const Picture picture = shown(*method, view_of(scene.frames[frame.frame], scene.cameras[0], 0));
    sum += psnr(picture.rgb, on_white(frame)) / static_cast<double>(test.frames.size());
    const std::vector<double> truth = made.distances(made.seats.at(frame.frame));
    std::vector<double> ratios;
    for (size_t i = 0; i < truth.size(); ++i) ratios.push_back(static_cast<double>(picture.depth[i]) / truth[i]);
    std::nth_element(ratios.begin(), ratios.begin() + static_cast<std::ptrdiff_t>(ratios.size() / 2), ratios.end());
    CHECK(ratios[ratios.size() / 2] == doctest::Approx(1).epsilon(0.1));
  }
  const double baseline = mean_colour_figure(scene);
  MESSAGE("psnr ", sum, ", mean colour ", baseline);
  CHECK(sum > baseline + 5);
}
