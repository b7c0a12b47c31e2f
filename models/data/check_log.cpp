// See check_log.h.
#include "models/data/check_log.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <span>

#include "models/data/load_sweep.h"
#include "models/data/reader.h"
#include "models/io/image.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr std::size_t kMaxCompared = 20;  // steps whose images are read
constexpr int kReach = 4;                 // displacements to either side, so 9 x 9 of them
constexpr int kPlaces = 2 * kReach + 1;
constexpr int kBins = 16;            // of brightness and of intensity
constexpr double kNearest = 0.5;     // metres in front of a camera
constexpr double kBoxMargin = 0.05;  // metres: boxes are drawn tightly

double median(std::vector<double> values) {
  if (values.empty()) return 0;
  std::nth_element(values.begin(), values.begin() + std::ptrdiff_t(values.size() / 2), values.end());
  return values[values.size() / 2];
}

// The time stamps of one sensor by step.
using Times = std::map<int, double>;

std::map<std::string, Times> times_by_sensor(const Scene& scene) {
  std::map<std::string, Times> times;
  for (const Frame& frame : scene.frames) {
    if (frame.timestamp) times[frame.sensor].emplace(frame.step, *frame.timestamp);
  }
  for (const Sweep& sweep : scene.sweeps) times["lidar"].emplace(sweep.step, sweep.timestamp);
  return times;
}

/// The median of a sensor's gaps: a step, and between its own times.
struct Period {
  double step, sensor;
};

Period period_of(const Times& times) {
  std::vector<double> steps, gaps;
  for (auto now = times.begin(); now != times.end() && std::next(now) != times.end(); ++now) {
    gaps.push_back(std::next(now)->second - now->second);
    steps.push_back(gaps.back() / (std::next(now)->first - now->first));
  }
  return {median(steps), median(gaps)};
}

void check_order(const std::string& sensor, const Times& times, std::vector<std::string>& warnings) {
  const Period usual = period_of(times);
  for (auto now = times.begin(); now != times.end() && std::next(now) != times.end(); ++now) {
    const auto next = std::next(now);
    const double gap = next->second - now->second;
    const bool backwards = gap <= 0;
    // A sensor with a rate of its own is at every second step, then at the next: its own gaps are even.
    const bool even = gap < 1.5 * usual.step * (next->first - now->first) || gap < 1.5 * usual.sensor;
    if (!backwards && even) continue;
    warnings.push_back(text(sensor, ": ", gap, " s from step ", now->first, " to step ", next->first,
                            backwards ? ": time stamps must increase" : text(" (usually ", usual.step, " s)")));
    return;  // one is enough
  }
}

void check_offset(const std::string& sensor, const Times& times, const Times& lidar, LogReport& report) {
  std::vector<double> offsets;
  for (const auto& [step, time] : times) {
    const auto found = lidar.find(step);
    if (found != lidar.end()) offsets.push_back(time - found->second);
  }
  const double offset = median(offsets), period = period_of(lidar).step;
  if (sensor != "lidar") report.clock.cameras_after[sensor] = offset;
  if (period > 0 && std::abs(offset) > 0.75 * period) {
    report.warnings.push_back(text(sensor, ": its images are taken ", std::abs(offset), " s ",
                                   offset < 0 ? "before" : "after", " the LiDAR sweeps of the same step"));
  }
}

void check_times(const Scene& scene, LogReport& report) {
  const auto times = times_by_sensor(scene);
  if (times.empty()) return;
  const auto lidar = times.find("lidar");
  const Times& leading = lidar == times.end() ? times.begin()->second : lidar->second;
  report.seconds = leading.rbegin()->second - leading.begin()->second;
  const double period = period_of(leading).step;
  report.rate = period > 0 ? 1 / period : 0;
  for (const auto& [sensor, stamps] : times) {
    report.steps = std::max(report.steps, stamps.rbegin()->first + 1);
    check_order(sensor, stamps, report.warnings);
    if (lidar != times.end()) check_offset(sensor, stamps, lidar->second, report);
  }
}

bool has_point(const LidarPoints& points, const Actor& actor, const ActorBox& box) {
  const Eigen::Matrix3d box_from_world = box.world_from_box.topLeftCorner<3, 3>().transpose();
  const Eigen::Vector3d centre = box.world_from_box.topRightCorner<3, 1>(),
                        half = 0.5 * actor.size + Eigen::Vector3d::Constant(kBoxMargin);
  const double reach = half.squaredNorm();
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector3d offset = Eigen::Vector3f(&points.positions[3 * i]).cast<double>() - centre;
    if (offset.squaredNorm() > reach) continue;
    if (((box_from_world * offset).cwiseAbs() - half).maxCoeff() <= 0) return true;
  }
  return false;
}

void check_boxes(const Scene& scene, const Sweep& sweep, const LidarPoints& points, LogReport& report) {
  for (const Actor& actor : scene.actors) {
    for (const ActorBox& box : actor.boxes) {
      if (box.step != sweep.step) continue;
      report.boxes_without_points += !has_point(points, actor, box);
      const double after = box.timestamp - sweep.timestamp;
      report.clock.first_box_after = std::min(report.clock.first_box_after, after);
      report.clock.last_box_after = std::max(report.clock.last_box_after, after);
    }
  }
}

// For each displacement, how often a return of one intensity lies on a pixel of one brightness.
struct Comparison {
  LidarFit fit;
  std::size_t points = 0;
  std::vector<double> counts = std::vector<double>(kPlaces * kPlaces * kBins * kBins);
};

int bin(double share) { return std::clamp(static_cast<int>(share * kBins), 0, kBins - 1); }

std::vector<int> brightness_bins(const Image& image) {
  std::vector<int> bins(std::size_t(image.width) * image.height);
  for (std::size_t i = 0; i < bins.size(); ++i) {
    const std::uint8_t* pixel = &image.pixels[i * image.channels];
    const bool grey = image.channels < 3;
    bins[i] = bin((grey ? pixel[0] : 0.299 * pixel[0] + 0.587 * pixel[1] + 0.114 * pixel[2]) / 256);
  }
  return bins;
}

void compare(const Camera& camera, const Frame& frame, const LidarPoints& points, const std::vector<int>& brightness,
             Comparison& comparison) {
  const Eigen::Matrix4d camera_from_world = frame.world_from_camera.inverse();
  const int spacing = comparison.fit.spacing, margin = kReach * spacing;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector3d world = Eigen::Vector3f(&points.positions[3 * i]).cast<double>();
    const Eigen::Vector3d seen = (camera_from_world * world.homogeneous()).head<3>();
    if (seen.z() < kNearest) continue;
    const Eigen::Vector2d place = project(camera, seen);
    const bool inside = place.x() >= margin && place.x() < camera.width - margin && place.y() >= margin &&
                        place.y() < camera.height - margin;
    if (!inside) continue;  // every displacement is judged by the same points
    ++comparison.points;
    const int column = static_cast<int>(place.x()), row = static_cast<int>(place.y());
    for (int shift = 0; shift < kPlaces * kPlaces; ++shift) {
      const int y = row + (shift / kPlaces - kReach) * spacing, x = column + (shift % kPlaces - kReach) * spacing;
      const int cell = brightness[std::size_t(y) * camera.width + x] * kBins + bin(points.intensities[i]);
      ++comparison.counts[std::size_t(shift * kBins * kBins + cell)];
    }
  }
}

// In nats, of a table of counts.
double mutual_information(std::span<const double> counts) {
  const Eigen::Map<const Eigen::Matrix<double, kBins, kBins>> table(counts.data());
  const double total = table.sum();
  if (total == 0) return 0;
  const Eigen::VectorXd rows = table.rowwise().sum();
  const Eigen::RowVectorXd columns = table.colwise().sum();
  double information = 0;
  for (int r = 0; r < kBins; ++r) {
    for (int c = 0; c < kBins; ++c) {
      if (table(r, c) > 0) information += table(r, c) / total * std::log(table(r, c) * total / (rows[r] * columns[c]));
    }
  }
  return information;
}

LidarFit finish(const Comparison& comparison) {
  constexpr std::size_t kNone = kPlaces * kReach + kReach;
  std::vector<double> scores;
  for (std::size_t shift = 0; shift < kPlaces * kPlaces; ++shift) {
    scores.push_back(mutual_information(std::span(comparison.counts).subspan(shift * kBins * kBins, kBins * kBins)));
  }
  LidarFit fit = comparison.fit;
  fit.points_per_image = double(comparison.points) / double(std::max<std::size_t>(fit.images, 1));
  const auto worse = std::count_if(scores.begin(), scores.end(), [&](double score) { return score < scores[kNone]; });
  fit.share_worse = double(worse) / double(scores.size() - 1);
  const auto best = std::max_element(scores.begin(), scores.end()) - scores.begin();
  if (scores[std::size_t(best)] > scores[kNone]) {
    fit.offset_x = double(best % kPlaces - kReach) * fit.spacing;
    fit.offset_y = double(best / kPlaces - kReach) * fit.spacing;
  }
  return fit;
}

// At most so many of all steps, evenly.
std::set<int> compared_steps(const Scene& scene) {
  std::set<int> steps;
  const std::size_t count = scene.sweeps.size(), chosen = std::min(count, kMaxCompared);
  for (std::size_t i = 0; i < chosen; ++i) steps.insert(scene.sweeps[i * count / chosen].step);
  return steps;
}

void warn_of_misfit(const LidarFit& fit, const Comparison& comparison, std::vector<std::string>& warnings) {
  constexpr std::size_t kEnough = 2000;
  if (comparison.points < kEnough || fit.aligned()) return;
  warnings.push_back(text(fit.sensor, ": LiDAR points fit the images better when moved by (", fit.offset_x, ", ",
                          fit.offset_y, ") px: are poses, intrinsics and time stamps right?"));
}

using Comparisons = std::map<std::string, Comparison>;

void compare_images(const Scene& scene, const Sweep& sweep, const LidarPoints& points, Comparisons& comparisons) {
  for (const Frame& frame : scene.frames) {
    if (frame.step != sweep.step) continue;
    const Image image = read_image(scene.root / frame.image);
    const Camera camera = resized(scene.cameras[std::size_t(frame.camera)], image.width, image.height);
    Comparison& comparison = comparisons[frame.sensor];
    comparison.fit.sensor = frame.sensor;
    comparison.fit.spacing = std::max(1, (camera.width + 160) / 320);
    ++comparison.fit.images;
    compare(camera, frame, points, brightness_bins(image), comparison);
  }
}

}  // namespace

LogReport check_log(const Scene& scene, bool skip_bad) {
  LogReport report;
  check_times(scene, report);
  report.sweeps = scene.sweeps.size();
  report.actors = scene.actors.size();
  for (const Actor& actor : scene.actors) report.boxes += actor.boxes.size();
  for (const Frame& frame : scene.frames)
    if (frame.ego_rows > 0) report.clock.car_rows[frame.sensor] = frame.ego_rows;
  Comparisons comparisons;
  const std::set<int> compared = compared_steps(scene);
  for (const Sweep& sweep : scene.sweeps) {
    guarded(skip_bad, report.warnings, "left out of the check", [&] {
      const LidarPoints points = load_sweep(scene, sweep);
      report.points_per_sweep += double(points.size()) / double(scene.sweeps.size());
      report.points_dropped += points.dropped;
      report.clock.car_points += points.of_ego;
      report.clock.second_lidar_points += std::size_t(std::count(points.sensors.begin(), points.sensors.end(), 1));
      check_boxes(scene, sweep, points, report);
      if (compared.contains(sweep.step)) compare_images(scene, sweep, points, comparisons);
    });
  }
  for (const auto& [sensor, comparison] : comparisons) {
    report.fits.push_back(finish(comparison));
    warn_of_misfit(report.fits.back(), comparison, report.warnings);
  }
  if (report.points_dropped > 0) {
    report.warnings.push_back(text(report.points_dropped, " LiDAR points dropped: NaN, infinite or too far away"));
  }
  if (report.sweeps > 0 && 2 * report.boxes_without_points > report.boxes) {
    report.warnings.push_back(text(report.boxes_without_points, " of ", report.boxes,
                                   " boxes hold no LiDAR point: are boxes and points in the same coordinate frame?"));
  }
  return report;
}

}  // namespace cloam
