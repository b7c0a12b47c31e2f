// Pictures of geometry: ellipsoids, normals, depths, opacity, against closed forms.
#include "models/eval/geometry_pictures.h"

#include <doctest/doctest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <cstring>

#include "models/eval/pictures.h"
#include "models/eval/sample_pictures.h"
#include "models/eval/seen_points.h"
#include "models/gaussians/ellipsoids.h"
#include "tests/models/folder.h"

namespace cloam {
namespace {

Camera small_camera(CameraModel model = CameraModel::pinhole) {
  Camera camera;
  camera.width = 40, camera.height = 30;
  camera.fx = camera.fy = 30, camera.cx = 20, camera.cy = 15;
  camera.model = model;
  return camera;
}

View view_from(const Eigen::Vector3d& place, const Camera& camera) {
  View view{camera, Eigen::Matrix4d::Identity()};
  view.world_from_camera.block<3, 3>(0, 0) =
      Eigen::AngleAxisd(0.2, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix();
  view.world_from_camera.block<3, 1>(0, 3) = place;
  return view;
}

struct Made {
  Eigen::Vector3d mean, deviations;
  Eigen::Quaterniond turn = Eigen::Quaterniond::Identity();
  double opacity = 5;  // logit
  Eigen::Vector3d colour = {1, 0.5, 0.25};
};

Gaussians gaussians_of(const std::vector<Made>& all) {
  Gaussians g;
  for (const Made& one : all) {
    for (int axis = 0; axis < 3; ++axis) {
      g.means.push_back(static_cast<float>(one.mean[axis]));
      g.scales.push_back(static_cast<float>(std::log(one.deviations[axis])));
      g.sh_first.push_back(static_cast<float>((one.colour[axis] - 0.5) / kSphericalFirst));
    }
    // Files and training hold rotations of any length.
    for (const double q : {one.turn.w(), one.turn.x(), one.turn.y(), one.turn.z()})
      g.rotations.push_back(static_cast<float>(3 * q));
    g.opacities.push_back(static_cast<float>(one.opacity));
    g.sh_rest.insert(g.sh_rest.end(), 3 * kSphericalRest, 0.f);
  }
  return g;
}

Eigen::Vector3d ray_of(const View& view, size_t pixel) {
  const std::vector<float> directions = pixel_directions(view.camera);
  const Eigen::Vector3d way = Eigen::Map<const Eigen::Vector3f>(directions.data() + 3 * pixel).cast<double>();
  return view.world_from_camera.block<3, 3>(0, 0) * way.normalized();
}

/// Deviations from the mean.
double apart(const Made& one, const Eigen::Vector3d& point) {
  return (one.turn.conjugate() * (point - one.mean)).cwiseQuotient(one.deviations).norm();
}

size_t seen_pixels(const Picture& picture) {
  return static_cast<size_t>(std::count(picture.opacity.begin(), picture.opacity.end(), 1.f));
}

}  // namespace

TEST_CASE("a picture of samples: columns are rays, rows steps of the distance's logarithm, brightness light") {
  // 1, 10 and 100 away: the bottom row, the middle one, the top one.
  const std::vector<RaySample> samples = {{0, 1.f, 0.f}, {1, 10.f, 1.f}, {2, 100.f, 0.25f}, {2, 100.f, 0.f}};
  const Image image = sample_picture(samples, 4, 5);
  const auto blue = [&](int x, int y) { return image.pixels.at(static_cast<size_t>(3 * (y * 4 + x) + 2)); };
  for (int y = 0; y < 5; ++y)
    for (int x = 0; x < 4; ++x)
      CHECK((blue(x, y) > 0) == ((x == 0 && y == 4) || (x == 1 && y == 2) || (x == 2 && y == 0)));
  CHECK(blue(1, 2) == 255);
  CHECK(blue(0, 4) == doctest::Approx(0.45 * 255).epsilon(0.01));
  CHECK(blue(2, 0) == doctest::Approx((0.45 + 0.55 * 0.5) * 255).epsilon(0.01));  // the root of a quarter
  CHECK(sample_picture({}, 2, 2).pixels == std::vector<uint8_t>(12, 0));
}

TEST_CASE("ellipsoids: each ray that meets one ends on its near surface, and no other ray sees it") {
  const Made made{{0.3, -0.2, 6}, {0.5, 1.5, 0.25}, Eigen::Quaterniond(0.8, 0.3, -0.4, 0.2).normalized()};
  for (const CameraModel model : {CameraModel::pinhole, CameraModel::fisheye})
    for (const double deviations : {0.5, 1.0, 1.7}) {
      const View view = view_from({0.1, 0.2, 0.3}, small_camera(model));
      const Picture picture = ellipsoid_picture(gaussians_of({made}), view, {deviations});
      CHECK(seen_pixels(picture) >= 10);
      const Eigen::Vector3d eye = view.world_from_camera.block<3, 1>(0, 3);
      for (size_t i = 0; i < picture.depth.size(); ++i) {
        const Eigen::Vector3d way = ray_of(view, i);
        // The least distance from the mean along the ray, found in small steps.
        double least = 1e9;
        for (double t = 0; t < 12; t += 0.002) least = std::min(least, apart(made, eye + t * way));
        if (std::abs(least - deviations) < 1e-3) continue;  // on the outline
        CHECK((picture.opacity[i] == 1.f) == (least < deviations));
        if (picture.opacity[i] == 0.f) continue;
        const double t = static_cast<double>(picture.depth[i]);
        CHECK(apart(made, eye + t * way) == doctest::Approx(deviations).epsilon(1e-4));
        CHECK(apart(made, eye + (t + 1e-3) * way) < apart(made, eye + t * way));  // the near side
      }
    }
}

TEST_CASE("ellipsoids: the nearest is seen, in its colour where it faces the camera; faint and near ones are not") {
  const View view{small_camera(), Eigen::Matrix4d::Identity()};
  const Made near{{0.0167, 0.0167, 4}, {0.5, 0.5, 0.5}, Eigen::Quaterniond::Identity(), 5, {0.25, 0.5, 0.75}},
      far{{0, 0, 8}, {2, 2, 0.5}};
  Made faint = near, inside = near, behind = near;
  faint.mean.z() = 3, faint.opacity = -3;
  inside.mean.setZero();
  behind.mean.z() = -4;
  const Picture picture = ellipsoid_picture(gaussians_of({far, near, faint, inside, behind}), view, {1, 0.1, 0, 0.125});
  const size_t middle = 15 * 40 + 20;
  CHECK(picture.depth[middle] == doctest::Approx(3.5).epsilon(1e-3));
  CHECK(picture.rgb[3 * middle] == doctest::Approx(0.25).epsilon(0.01));
  CHECK(picture.rgb[3 * middle + 2] == doctest::Approx(0.75).epsilon(0.01));
  const size_t beside = 15 * 40 + 26;  // past the nearer one
  CHECK(picture.depth[beside] > 7);
  CHECK(picture.rgb[0] == 0.125f);
  CHECK(picture.opacity[0] == 0.f);
}

TEST_CASE("normals are those of the plane that the depths lie on, and edges have none") {
  const Camera camera = small_camera();
  const std::vector<float> directions = pixel_directions(camera);
  const Eigen::Vector3d normal = Eigen::Vector3d(0.4, -0.3, -0.8).normalized();  // looks at the camera
  Picture picture{camera.width, camera.height, {}, {}, {}, {}};
  for (int i = 0; i < camera.width * camera.height; ++i) {
    const Eigen::Vector3d way =
        Eigen::Map<const Eigen::Vector3f>(directions.data() + 3 * i).cast<double>().normalized();
    // A plane; right of column 30 the same plane half as far again.
    const double depth = normal.dot(Eigen::Vector3d(0, 0, 5)) / normal.dot(way);
    picture.depth.push_back(static_cast<float>(i % camera.width < 30 ? depth : 1.5 * depth));
    picture.opacity.push_back(1);
  }
  picture.opacity[12 * 40 + 10] = 0.4f;  // no surface
  const Image image = normal_picture(picture, camera);
  const auto at = [&](int x, int y, int c) {
    return image.pixels[static_cast<size_t>((y * 40 + x) * image.channels + c)];
  };
  const double shown[] = {normal.x(), -normal.y(), -normal.z()};
  for (const int x : {3, 20, 35})
    for (int c = 0; c < 3; ++c) CHECK(std::abs(at(x, 20, c) - (0.5 + 0.5 * shown[c]) * 255) < 2);
  for (int c = 0; c < 3; ++c) {
    CHECK(at(29, 20, c) == 0);  // an edge
    CHECK(at(30, 20, c) == 0);
    CHECK(at(10, 12, c) == 0);
    CHECK(at(11, 12, c) == 0);  // beside a hole
    CHECK(at(0, 20, c) == 0);   // the picture's rim
  }
}

namespace {

/// What a camera sees of a ball about the origin, of a colour that follows the place.
Picture ball_seen(const View& view, double radius) {
  Picture picture{view.camera.width, view.camera.height, {}, {}, {}, {}};
  const std::vector<float> directions = pixel_directions(view.camera);
  const Eigen::Vector3d eye = view.world_from_camera.topRightCorner<3, 1>();
  for (size_t i = 0; i < directions.size(); i += 3) {
    const Eigen::Vector3d way = (view.world_from_camera.topLeftCorner<3, 3>() *
                                 Eigen::Map<const Eigen::Vector3f>(&directions[i]).cast<double>())
                                    .normalized();
    const double along = -way.dot(eye), rest = along * along - eye.squaredNorm() + radius * radius;
    const double depth = rest > 0 ? along - std::sqrt(rest) : 0;
    picture.depth.push_back(static_cast<float>(depth));
    picture.opacity.push_back(rest > 0);
    for (const double value : Eigen::Vector3d(0.5 * (eye + depth * way) / radius))
      picture.rgb.push_back(static_cast<float>(std::clamp(value + 0.5, 0.0, 1.0)));
  }
  return picture;
}

/// Shows a ball.
struct BallShown : RendersViews {
  Picture render(const View& view) override { return ball_seen(view, 1); }
};

}  // namespace

TEST_CASE("an EXR has the depth along the optical axis as Z, and normals of the world as N") {
  const Folder folder;
  View view = view_from({0, 0, 0}, small_camera());
  view.world_from_camera.block<3, 1>(0, 3) = -3 * view.world_from_camera.block<3, 1>(0, 2);
  const Picture picture = ball_seen(view, 1);
  const std::filesystem::path file = folder.path / "a.exr";
  write_picture_exr(file, picture, view);
  const std::vector<float> z = read_exr_layer(file, "Z"), x = read_exr_layer(file, "N.X"),
                           y = read_exr_layer(file, "N.Y"), n = read_exr_layer(file, "N.Z");
  const std::vector<float> directions = pixel_directions(view.camera);
  CHECK(read_exr_layer(file, "depth.Z") == picture.depth);
  double worst = 0;
  int surface = 0;
  for (size_t i = 0; i < z.size(); ++i) {
    const Eigen::Vector3d at = Eigen::Map<const Eigen::Vector3f>(&directions[3 * i]).cast<double>() *
                               static_cast<double>(z[i]);  // a pinhole's directions have z = 1
    CHECK((z[i] > 0) == (picture.opacity[i] > 0));
    const Eigen::Vector3d normal(static_cast<double>(x[i]), static_cast<double>(y[i]), static_cast<double>(n[i]));
    if (normal.isZero()) continue;
    ++surface;
    worst = std::max(worst, (normal - (view.world_from_camera * at.homogeneous()).head<3>()).norm());
  }
  CHECK(surface > 100);
  CHECK(worst < 0.15);  // pixels are 0.07 wide on the ball; its points are its normals

  if (std::system("command -v ffmpeg >/dev/null 2>&1") != 0) {
    MESSAGE("skipped: no ffmpeg");
    return;
  }
  // FFmpeg has a reader of its own.
  const std::filesystem::path raw = folder.path / "n.raw";
  REQUIRE(
      std::system(("ffmpeg -v error -layer N -i " + file.string() + " -f rawvideo -pix_fmt gbrpf32le " + raw.string())
                      .c_str()) == 0);
  const std::string bytes = content_of(raw);
  REQUIRE(bytes.size() == 3 * 4 * z.size());
  const auto plane = [&](size_t which) {
    std::vector<float> values(z.size());
    std::memcpy(values.data(), bytes.data() + 4 * which * z.size(), 4 * z.size());
    return values;
  };
  CHECK(plane(0) == y);
  CHECK(plane(1) == n);
  CHECK(plane(2) == x);
}

TEST_CASE("points that the photos see lie on the surface, with its normals and colours") {
  Scene scene;
  scene.cameras = {small_camera()};
  for (int i = 0; i < 4; ++i) {
    Frame frame;
    const Eigen::Matrix3d turn = Eigen::AngleAxisd(1.5 * i, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix();
    frame.world_from_camera.block<3, 3>(0, 0) = turn;
    frame.world_from_camera.block<3, 1>(0, 3) = -3 * turn.col(2);
    frame.split = i == 3 ? Split::test : Split::train;
    scene.frames.push_back(frame);
  }
  BallShown ball;
  const Listener listener{[](const std::string&) {}, [](const std::string&) {}, [](const auto&) {}};
  const Mesh all = seen_points(ball, scene, 0, {}, listener), few = seen_points(ball, scene, 0, {30}, listener);
  CHECK(all.vertex_count() > 500);
  CHECK(few.vertex_count() == 3 * 10);
  CHECK(seen_points(ball, scene, 0, {1000, 1.5}, listener).vertex_count() == 0);  // the ball begins at 2
  for (const Mesh* points : {&all, &few}) {
    REQUIRE(points->normals.size() == points->positions.size());
    REQUIRE(points->colours.size() == points->positions.size());
    CHECK(points->triangles.empty());
    double worst = 0;
    for (size_t i = 0; i < points->positions.size(); i += 3) {
      const auto at = [&](const std::vector<float>& values) {
        return Eigen::Vector3d(Eigen::Map<const Eigen::Vector3f>(&values[i]).cast<double>());
      };
      CHECK(at(points->positions).norm() == doctest::Approx(1));
      CHECK((at(points->colours) - Eigen::Vector3d::Constant(0.5) - 0.5 * at(points->positions)).norm() < 1e-5);
      worst = std::max(worst, (at(points->normals) - at(points->positions)).norm());
    }
    CHECK(worst < (points == &all ? 0.15 : 0.3));
  }
}

TEST_CASE("depths go from red to blue by their logarithm; opacity is grey") {
  Picture picture{101, 1, {}, {}, {}, {}};
  for (int i = 0; i <= 100; ++i) {
    picture.depth.push_back(static_cast<float>(std::exp(0.05 * i)));
    picture.opacity.push_back(0.6f);
  }
  picture.opacity[40] = 0.2f;
  const Image image = depth_picture(picture), opacity = opacity_picture(picture);
  const auto at = [&](int x) {
    const auto* rgb = image.pixels.data() + static_cast<size_t>(x * image.channels);
    return std::array<int, 3>{rgb[0], rgb[1], rgb[2]};
  };
  CHECK(at(1) == std::array<int, 3>{128, 0, 0});
  CHECK(at(100) == std::array<int, 3>{0, 0, 128});
  CHECK(at(50)[0] == std::lround(255 * (1.5 - (3 - 4 * (1 - 49.0 / 97)))));  // half way between the ends, 1 and 98
  CHECK(at(50)[1] == 255);
  CHECK(at(40) == std::array<int, 3>{0, 0, 0});
  CHECK(opacity.pixels[0] == 153);
  CHECK(opacity.pixels[static_cast<size_t>(40 * opacity.channels + 1)] == 51);
}

}  // namespace cloam
