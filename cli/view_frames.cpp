// See view_frames.h.
#include "cli/view_frames.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "cli/common.h"
#include "models/data/poses.h"
#include "models/io/image.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr double kLargestSide = 8192, kMostPixels = 1 << 24;
constexpr double kLongestTime = 1e12;  // seconds
constexpr double kSecondsOfLevel[] = {0.2, 1};
constexpr int kScales[] = {1, 2, 3, 4, 6, 8, 12, 16};  // a coarser picture shows nothing
constexpr int kWarmSide = 80;                          // pixels
constexpr double kKept = 0.8;                          // how much a measurement still counts when the next one is made
const char* const kFrameRequest = "the request";

double number_between(const Json& request, const char* key, double least, double most) {
  const double value = number(request, key, kFrameRequest);
  if (value >= least && value <= most) return value;
  bad_data(kFrameRequest, ": \"", key, "\" is ", value, ", want ", least, " to ", most);
}

int whole_between(const Json& request, const char* key, double least, double most) {
  const double value = number_between(request, key, least, most);
  if (value == std::floor(value)) return static_cast<int>(value);
  bad_data(kFrameRequest, ": \"", key, "\" is ", value, ", want a whole number");
}

Eigen::Matrix4d pose_in(const Json& request) {
  const Json& numbers = array(request, "world_from_camera", kFrameRequest);
  Eigen::Matrix4d pose = Eigen::Matrix4d::Identity();
  if (numbers.size() != 12)
    bad_data(kFrameRequest, ": \"world_from_camera\" has ", numbers.size(), " numbers, want 12: three rows of four");
  for (int i = 0; i < 12; ++i) {
    const Json& value = numbers[static_cast<std::size_t>(i)];
    if (!value.is_number() || !std::isfinite(value.get<double>()))
      bad_data(kFrameRequest, ": \"world_from_camera\" holds ", value.dump().substr(0, 40), ", want 12 finite numbers");
    pose(i / 4, i % 4) = value.get<double>();
  }
  return rigid(pose, kFrameRequest);
}

Camera shrunk(const Camera& camera, int scale) {
  return scale == 1 ? camera : resized(camera, std::max(1, camera.width / scale), std::max(1, camera.height / scale));
}

double pixels_of(const Camera& camera) { return static_cast<double>(camera.width) * camera.height; }

/// Without what compiling took, which happens once.
double seconds_without_builds() { return seconds_since_start() - device_stats().build_seconds; }

}  // namespace

View view_in(const Json& request, int scene) {
  Camera camera;
  camera.width = whole_between(request, "width", 1, kLargestSide);
  camera.height = whole_between(request, "height", 1, kLargestSide);
  if (pixels_of(camera) > kMostPixels)
    bad_data(kFrameRequest, ": ", camera.width, "x", camera.height, " pixels, want ", kMostPixels, " at most");
  camera.fx = number(request, "fx", kFrameRequest);
  camera.fy = number(request, "fy", kFrameRequest);
  camera.cx = number(request, "cx", kFrameRequest);
  camera.cy = number(request, "cy", kFrameRequest);
  require_sound(camera, kFrameRequest);
  const double time = request.contains("time") && !request["time"].is_null()
                          ? number_between(request, "time", -kLongestTime, kLongestTime)
                          : 0;
  return {camera, pose_in(request), scene, time};
}

FrameRequest frame_request(const Json& request, int scene) {
  FrameRequest out;
  out.client = string(request, "client", kFrameRequest);
  if (out.client.empty() || out.client.size() > 100)
    bad_data(kFrameRequest, ": \"client\" has ", out.client.size(), " letters, want 1 to 100");
  out.number = static_cast<int64_t>(number_between(request, "number", 0, 9e15));
  out.level = whole_between(request, "level", 0, 2);
  const std::string format = optional_string(request, "format", kFrameRequest).value_or("jpeg");
  if (format != "jpeg" && format != "png") bad_data(kFrameRequest, ": \"format\" is ", format, ", want jpeg or png");
  out.png = format == "png";
  out.view = view_in(request, scene);
  return out;
}

void FramePace::add(double pixels, double seconds) {
  weight_ = kKept * weight_ + 1;
  pixels_ = kKept * pixels_ + pixels;
  seconds_ = kKept * seconds_ + seconds;
  squares_ = kKept * squares_ + pixels * pixels;
  products_ = kKept * products_ + pixels * seconds;
}

/// The line of least squares; proportional where that makes no sense: all of one size, or larger ones were faster.
double FramePace::seconds_for(double pixels) const {
  const double spread = weight_ * squares_ - pixels_ * pixels_;
  const double slope = spread > 1e-9 * weight_ * squares_ ? (weight_ * products_ - pixels_ * seconds_) / spread : 0;
  const double fixed = (seconds_ - slope * pixels_) / weight_;
  if (slope <= 0 || fixed < 0) return pixels * products_ / squares_;
  return fixed + slope * pixels;
}

/// What others did between the parts takes no part in its pace.
Picture FrameMaker::render(View view) {
  double begin = seconds_without_builds();
  view.between = [&begin, between = view.between] {
    const double before = seconds_without_builds();
    between();
    begin += seconds_without_builds() - before;
  };
  Picture picture = renders_->render(view);
  pace_.add(pixels_of(view.camera), seconds_without_builds() - begin);
  return picture;
}

void FrameMaker::warm_up(const std::vector<View>& views) {
  const auto small = [](View view, int side) {
    view.camera = shrunk(view.camera, std::max(1, std::max(view.camera.width, view.camera.height) / side));
    return view;
  };
  for (const View& view : views) renders_->render(small(view, kWarmSide));
  for (const int side : {kWarmSide, 2 * kWarmSide}) render(small(views.front(), side));
}

int FrameMaker::scale_for(const FrameRequest& request) const {
  if (request.level == 2) return 1;
  if (!pace_.is_known()) return std::end(kScales)[-1];
  for (const int scale : kScales)
    if (pace_.seconds_for(pixels_of(shrunk(request.view.camera, scale))) <= kSecondsOfLevel[request.level])
      return scale;
  return std::end(kScales)[-1];
}

Answer FrameMaker::frame(const FrameRequest& request, const std::function<void()>& between) {
  const double before = seconds_since_start();
  const int scale = scale_for(request);
  View view = request.view;
  view.camera = shrunk(request.view.camera, scale);
  view.between = between;
  const Picture picture = render(view);
  const Image image = to_image(picture.rgb, picture.width, picture.height);
  const std::vector<std::uint8_t> bytes = request.png ? png_bytes(image) : jpeg_bytes(image);
  return {{bytes.begin(), bytes.end()},
          request.png ? "image/png" : "image/jpeg",
          {{"X-Number", std::to_string(request.number)},
           {"X-Scale", std::to_string(scale)},
           {"X-Milliseconds", std::to_string(std::lround(1000 * (seconds_since_start() - before)))}}};
}

}  // namespace cloam
