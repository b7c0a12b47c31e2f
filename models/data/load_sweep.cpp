// See load_sweep.h. Each format gives the same columns; what is no point is dropped from them in one place.
#include "models/data/load_sweep.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "models/data/data_frame.h"
#include "models/data/waymo.h"
#include "models/io/bytes.h"
#include "models/io/npy.h"
#include "models/io/ply.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr double kFarthestReturn = 1e6;
// The car that carries the LiDAR, metres around it: nothing else comes so near, and the ground there is hidden.
constexpr double kEgoRadius = 2.5, kEgoAbove = 0.5;
constexpr double kBrightestReturn = 255;
constexpr std::uint64_t kMaxSweepBytes = std::uint64_t{256} << 20;

// Those that a file lacks are empty and count as 0.
struct Columns {
  std::vector<double> x, y, z;    // metres
  std::vector<double> intensity;  // 0 to 1
  std::vector<double> time;       // seconds after the sweep's time stamp
  std::vector<double> sensor;

  std::size_t size() const { return x.size(); }
};

double entry(const std::vector<double>& column, std::size_t row) { return column.empty() ? 0 : column[row]; }

// PandaSet: x y z, i from 0 to 255, t in absolute seconds, d the LiDAR.
Columns read_data_frame_points(const fs::path& path, const Sweep& sweep) {
  const DataFrame frame = read_data_frame(path);
  Columns columns{frame.numbers("x"), frame.numbers("y"), frame.numbers("z"),
                  frame.numbers("i"), frame.numbers("t"), {}};
  for (double& value : columns.intensity) value /= kBrightestReturn;
  for (double& value : columns.time) value -= sweep.timestamp;
  if (frame.has("d")) columns.sensor = frame.numbers("d");
  return columns;
}

// Rows of float32 one after another; their columns by name.
Columns read_rows(const fs::path& path, std::size_t numbers, const char* names) {
  const auto bytes = read_file(path, kMaxSweepBytes);
  const std::size_t size = numbers * sizeof(float);
  if (bytes.size() % size != 0)
    bad_data(path.string(), ": holds ", bytes.size(), " bytes, want a multiple of ", size, " (", names,
             " as float32); the file is damaged or truncated");
  ByteReader reader(bytes, path.string());
  Columns columns;
  while (reader.remaining() > 0) {
    for (auto* column : {&columns.x, &columns.y, &columns.z, &columns.intensity})
      column->push_back(double(reader.little<float>("a point")));
    reader.skip(size - 4 * sizeof(float), "a point");
  }
  return columns;
}

// KITTI: reflectance from 0 to 1.
Columns read_kitti_points(const fs::path& path, const Sweep&) { return read_rows(path, 4, "x y z reflectance"); }

// nuScenes: intensity from 0 to 255, and the number of the beam.
Columns read_nuscenes_points(const fs::path& path, const Sweep&) {
  Columns columns = read_rows(path, 5, "x y z intensity ring");
  for (double& value : columns.intensity) value /= kBrightestReturn;
  return columns;
}

// Waymo: places from the first return's LiDAR, of the one on the roof alone; the others see a few metres.
Columns read_waymo_points(const fs::path& path, const Sweep&) {
  const auto bytes = read_file(path, kMaxSweepBytes);
  constexpr std::size_t size = kWaymoPointNumbers * sizeof(float);
  if (bytes.size() % size != 0)
    bad_data(path.string(), ": holds ", bytes.size(), " bytes, want a multiple of ", size,
             " (14 float32 a point); the file is damaged or truncated");
  ByteReader reader(bytes, path.string());
  Columns columns;
  std::optional<Eigen::Vector3d> lidar;
  while (reader.remaining() > 0) {
    std::array<double, kWaymoPointNumbers> row;
    for (double& number : row) number = double(reader.little<float>("a point"));
    if (row[13] != 0) continue;
    if (!lidar) lidar = Eigen::Vector3d(row[0], row[1], row[2]);
    columns.x.push_back(row[3] - lidar->x());
    columns.y.push_back(row[4] - lidar->y());
    columns.z.push_back(row[5] - lidar->z());
    columns.intensity.push_back(row[11]);
  }
  return columns;
}

// From 0 to 255 where any is above 1.
void scale_intensity(std::vector<double>& values) {
  const bool bytes = std::any_of(values.begin(), values.end(), [](double value) { return value > 1; });
  for (double& value : values) value /= bytes ? kBrightestReturn : 1;
}

// [N, 3 or more]: x y z, intensity, seconds after the time stamp; what follows is left out.
Columns read_npy_points(const fs::path& path, const Sweep&) {
  const auto bytes = read_file(path, kMaxSweepBytes);
  const NpyArray array = parse_npy(bytes, path.string());
  if (array.shape.size() != 2 || array.shape[1] < 3)
    bad_data(path.string(), ": looked for an array of shape [N, 3] (x y z) or [N, 4] with ", "intensity, found ",
             array.shape.size(), " axes", array.shape.size() == 2 ? text(", the second of ", array.shape[1]) : "");
  const std::vector<float> values = npy_floats(array);
  const std::size_t rows = array.shape[0], width = array.shape[1];
  Columns columns;
  std::vector<double>* targets[] = {&columns.x, &columns.y, &columns.z, &columns.intensity, &columns.time};
  for (std::size_t c = 0; c < std::min(width, std::size(targets)); ++c) {
    for (std::size_t row = 0; row < rows; ++row) targets[c]->push_back(double(values[row * width + c]));
  }
  scale_intensity(columns.intensity);
  return columns;
}

Columns read_ply_points(const fs::path& path, const Sweep&) {
  const PlyVertices vertices = read_ply_vertices(path);
  const auto doubles = [](const std::vector<float>& values) {
    return std::vector<double>(values.begin(), values.end());
  };
  Columns columns{
      doubles(vertices.column("x")), doubles(vertices.column("y")), doubles(vertices.column("z")), {}, {}, {}};
  if (const PlyColumn* found = vertices.find("intensity")) columns.intensity = doubles(found->values);
  if (const PlyColumn* found = vertices.find("time")) columns.time = doubles(found->values);
  scale_intensity(columns.intensity);
  return columns;
}

// Whether the point, in axes of the LiDAR as it saw it, is of the recording car. Without a box for the car: in a space
// around the LiDAR that nothing else comes into.
bool is_of_ego(const Eigen::Vector3d& from_lidar, const std::optional<CarBox>& car) {
  if (car) return ((from_lidar - car->centre).cwiseAbs() - 0.5 * car->size).maxCoeff() <= 0;
  return from_lidar.head<2>().norm() < kEgoRadius && from_lidar.z() < kEgoAbove;
}

struct PointReader {
  const char* format;  // of the scene; "": any
  const char* ending;  // of the file's name
  Columns (*read)(const fs::path& path, const Sweep& sweep);
};

constexpr PointReader kPointReaders[] = {
    {"Waymo", ".bin", read_waymo_points},   {"", ".gz", read_data_frame_points}, {"", ".pkl", read_data_frame_points},
    {"", ".pcd.bin", read_nuscenes_points}, {"", ".bin", read_kitti_points},     {"", ".npy", read_npy_points},
    {"", ".ply", read_ply_points},
};

Columns read_columns(const Scene& scene, const Sweep& sweep) {
  const fs::path path = scene.root / sweep.file;
  const auto reader = std::find_if(std::begin(kPointReaders), std::end(kPointReaders), [&](const PointReader& known) {
    const bool of_format = known.format[0] == 0 || scene.format == known.format;
    return of_format && path.filename().string().ends_with(known.ending);
  });
  if (reader != std::end(kPointReaders)) return reader->read(path, sweep);
  bad_data(path.string(),
           ": cannot read LiDAR points from this kind of file; supported: .pkl.gz, .pkl, .bin, .npy, .ply");
}

}  // namespace

LidarPoints load_sweep(const Scene& scene, const Sweep& sweep) {
  const Columns columns = read_columns(scene, sweep);
  const Eigen::Matrix4d world_from_points =
      sweep.points_in_world ? Eigen::Matrix4d::Identity().eval() : sweep.world_from_lidar;
  LidarPoints points;
  for (std::size_t row = 0; row < columns.size(); ++row) {
    const Eigen::Vector4d given(columns.x[row], columns.y[row], columns.z[row], 1);
    const Eigen::Vector3d place = (world_from_points * given).head<3>();
    const double intensity = entry(columns.intensity, row), time = entry(columns.time, row);
    const bool sound = std::isfinite(intensity) && std::isfinite(time) && place.cwiseAbs().maxCoeff() < kFarthestReturn;
    if (!sound || !place.allFinite()) {
      ++points.dropped;
      continue;
    }
    Eigen::Vector3d from_lidar = place - seen_from(sweep, 0, time).origin;
    if (scene.recording.car) from_lidar = sweep.world_from_lidar.topLeftCorner<3, 3>().transpose() * from_lidar;
    if (is_of_ego(from_lidar, scene.recording.car)) {
      ++points.of_ego;
      continue;
    }
    for (int axis = 0; axis < 3; ++axis) points.positions.push_back(static_cast<float>(place[axis]));
    points.intensities.push_back(static_cast<float>(std::clamp(intensity, 0.0, 1.0)));
    points.times.push_back(static_cast<float>(time));
    points.sensors.push_back(entry(columns.sensor, row) == 1 ? 1 : 0);
  }
  return points;
}

}  // namespace cloam
