// See colmap_model.h. Both kinds of file fill the same records; a table says what each lens's parameters are.
#include "models/data/colmap_model.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "models/data/poses.h"
#include "models/io/bytes.h"
#include "models/io/paths.h"
#include "models/io/safetensors_header.h"  // printable
#include "models/io/words.h"
#include "models/scene/pose.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kMaxModelBytes = std::uint64_t{1} << 33;
constexpr std::uint64_t kLongestSide = 1 << 17;
constexpr std::size_t kLongestName = 4096;

struct Lens {
  const char* name;
  CameraModel model;
  const char* parameters;  // in the order of the file, by the names of `place`
};

// The place in this table is the number in cameras.bin.
constexpr Lens kLenses[] = {
    {"SIMPLE_PINHOLE", CameraModel::pinhole, "f cx cy"},
    {"PINHOLE", CameraModel::pinhole, "fx fy cx cy"},
    {"SIMPLE_RADIAL", CameraModel::opencv, "f cx cy k1"},
    {"RADIAL", CameraModel::opencv, "f cx cy k1 k2"},
    {"OPENCV", CameraModel::opencv, "fx fy cx cy k1 k2 p1 p2"},
    {"OPENCV_FISHEYE", CameraModel::fisheye, "fx fy cx cy k1 k2 k3 k4"},
    {"FULL_OPENCV", CameraModel::opencv, "fx fy cx cy k1 k2 p1 p2 k3 d1 d2 d3"},
    {"FOV", CameraModel::fov, "fx fy cx cy k1"},
    {"SIMPLE_RADIAL_FISHEYE", CameraModel::fisheye, "f cx cy k1"},
    {"RADIAL_FISHEYE", CameraModel::fisheye, "f cx cy k1 k2"},
    {"THIN_PRISM_FISHEYE", CameraModel::fisheye, "fx fy cx cy k1 k2 p1 p2 k3 k4 s1 s2"},
};

double& place(Camera& camera, std::string_view name) {
  const auto number = static_cast<std::size_t>(name.back() - '1');
  if (name.starts_with('k')) return camera.k[number];
  if (name.starts_with('d')) return camera.denominator[number];
  if (name.starts_with('s')) return camera.prism[number];
  if (name.starts_with('p')) return number == 0 ? camera.p1 : camera.p2;
  if (name.starts_with('c')) return name == "cx" ? camera.cx : camera.cy;
  return name == "fy" ? camera.fy : camera.fx;
}

/// One record of a file after another, as numbers. `what` names the record for errors.
class Records {
 public:
  virtual ~Records() = default;
  virtual double real(const char* what) = 0;
  /// A whole number from 0 up; -1 in text is 2^64 - 1.
  virtual std::uint64_t whole(int bytes, const char* what) = 0;
  virtual std::string name() = 0;
  virtual std::string where() const = 0;
};

/// Little-endian.
class BinaryFile : public Records {
 public:
  explicit BinaryFile(const fs::path& path)
      : bytes_(read_file(path, kMaxModelBytes)), file_(path.string()), reader_(bytes_, file_) {}

  double real(const char* what) override { return reader_.little<double>(what); }
  std::uint64_t whole(int bytes, const char* what) override {
    if (bytes == 1) return reader_.little<std::uint8_t>(what);
    return bytes == 4 ? reader_.little<std::uint32_t>(what) : reader_.little<std::uint64_t>(what);
  }
  std::string name() override { return reader_.zero_ended(kLongestName, "an image's name"); }
  std::string where() const override { return text(file_, ", byte ", reader_.offset()); }

  /// A number of things, each of at least so many bytes, that the rest of the file can hold.
  std::uint64_t count(std::uint64_t least_bytes, const char* what) {
    const auto promised = reader_.little<std::uint64_t>(what);
    if (promised <= reader_.remaining() / least_bytes) return promised;
    bad_data(where(), ": ", promised, " ", what, " are declared, only ", reader_.remaining(),
             " bytes follow; the file is damaged or truncated");
  }
  void skip(std::uint64_t bytes, const char* what) { reader_.skip(bytes, what); }
  void end() const {
    if (reader_.remaining() == 0) return;
    bad_data(where(), ": ", reader_.remaining(), " bytes follow the last record; the file is damaged");
  }

 private:
  std::vector<std::uint8_t> bytes_;
  std::string file_;
  ByteReader reader_;
};

/// A record is a line of words; lines that are empty or begin with # are none.
class TextFile : public Records {
 public:
  explicit TextFile(const fs::path& path)
      : bytes_(read_file(path, kMaxModelBytes)),
        file_(path.string()),
        rest_(reinterpret_cast<const char*>(bytes_.data()), bytes_.size()) {
    constexpr std::string_view mark = "\xef\xbb\xbf";  // by which some editors on Windows show that a text is UTF-8
    if (rest_.starts_with(mark)) rest_.remove_prefix(mark.size());
  }

  double real(const char* what) override { return number<double>(what); }
  std::uint64_t whole(int bytes, const char* what) override {
    if (bytes == 1) return number<std::uint8_t>(what);
    if (bytes == 4) return number<std::uint32_t>(what);
    std::string_view rest = line_;
    const bool none = next_word(rest) == "-1";
    return none ? static_cast<std::uint64_t>(number<std::int64_t>(what)) : number<std::uint64_t>(what);
  }
  std::string name() override {
    line_.remove_prefix(std::min(line_.find_first_not_of(" \t"), line_.size()));
    const std::size_t end = line_.find_last_not_of(" \t\r");
    const std::string found(line_.substr(0, end == std::string_view::npos ? 0 : end + 1));
    line_ = {};
    if (found.empty() || found.size() > kLongestName) fail("looked for an image's name");
    return found;
  }
  std::string where() const override { return text(file_, ", line ", line_number_); }

  /// The next record; false at the end.
  bool next() {
    while (next_line()) {
      if (more() && !line_.starts_with('#')) return true;
    }
    return false;
  }
  /// The next line, whatever it holds: the observations of an image may be none.
  bool next_line() {
    if (rest_.empty()) return false;
    const std::size_t end = std::min(rest_.find('\n'), rest_.size());
    line_ = rest_.substr(0, end);
    rest_.remove_prefix(std::min(end + 1, rest_.size()));
    ++line_number_;
    return true;
  }
  /// Whether words are left in the line.
  bool more() const { return line_.find_first_not_of(" \t\r") != std::string_view::npos; }
  void end_line() const {
    if (more()) fail(text("'", printable(line_), "' follows the last value of the line"));
  }
  std::string word() { return std::string(next_word(line_)); }

 private:
  [[noreturn]] void fail(const std::string& why) const { bad_data(where(), ": ", why); }

  template <class Number>
  Number number(const char* what) {
    const std::string_view word = next_word(line_);
    const auto value = number_in<Number>(word);
    if (!value) fail(text("looked for ", what, ", found '", printable(word), "'"));
    return *value;
  }

  std::vector<std::uint8_t> bytes_;
  std::string file_;
  std::string_view rest_, line_;
  std::size_t line_number_ = 0;
};

int side(std::uint64_t pixels, const Records& file) {
  if (pixels >= 1 && pixels <= kLongestSide) return static_cast<int>(pixels);
  bad_data(file.where(), ": an image side of ", pixels, " pixels, want 1 to ", kLongestSide);
}

/// Distortion that is zero is none.
CameraModel simplest(const Camera& camera) {
  const Camera straight;
  const bool none = camera.k == straight.k && camera.p1 == 0 && camera.p2 == 0 &&
                    camera.denominator == straight.denominator && camera.prism == straight.prism;
  const bool perspective = camera.model == CameraModel::opencv || camera.model == CameraModel::fov;
  return none && perspective ? CameraModel::pinhole : camera.model;
}

void add_camera(ColmapModel& model, std::uint64_t id, const Lens& lens, Records& file) {
  Camera camera;
  camera.model = lens.model;
  camera.width = side(file.whole(8, "a camera's width"), file);
  camera.height = side(file.whole(8, "a camera's height"), file);
  std::string_view names = lens.parameters;
  for (std::string_view name = next_word(names); !name.empty(); name = next_word(names)) {
    const double value = file.real("a camera's parameter");
    if (!std::isfinite(value)) bad_data(file.where(), ": ", lens.name, "'s ", name, " is ", value);
    place(camera, name) = value;
    if (name == "f") camera.fy = value;
  }
  if (camera.model == CameraModel::fov) camera.k[0] = std::abs(camera.k[0]);  // the lens is the same for both signs
  if (camera.model == CameraModel::fov && camera.k[0] >= std::numbers::pi)
    bad_data(file.where(), ": FOV's omega is ", camera.k[0], ", want radians below pi");
  camera.model = simplest(camera);
  require_sound(camera, file.where());
  if (!model.cameras.emplace(static_cast<std::uint32_t>(id), camera).second)
    bad_data(file.where(), ": camera ", id, " is defined twice");
}

std::string lens_names() {
  std::vector<std::string_view> names;
  for (const Lens& lens : kLenses) names.emplace_back(lens.name);
  return fmt::format("{}", fmt::join(names, ", "));
}

[[noreturn]] void unknown_lens(const std::string& name, const Records& file) {
  bad_data(file.where(), ": the camera model ", name, " is not supported; supported: ", lens_names(),
           "; let COLMAP undistort the images (colmap image_undistorter)");
}

ColmapImage image_of(Records& file) {
  ColmapImage image;
  for (int i = 0; i < 4; ++i) image.rotation[i] = file.real("an image's rotation");
  for (int i = 0; i < 3; ++i) image.translation[i] = file.real("an image's translation");
  image.camera = static_cast<std::uint32_t>(file.whole(4, "an image's camera"));
  image.name = file.name();
  return image;
}

ColmapObservation observation_of(Records& file) {
  ColmapObservation found;
  for (int i = 0; i < 2; ++i) found.pixel[i] = file.real("a point in an image");
  found.point = file.whole(8, "a point in an image");
  return found;
}

constexpr std::uint64_t kNoPoint = ~std::uint64_t{0};

ColmapPoint point_of(Records& file) {
  ColmapPoint point;
  point.id = file.whole(8, "a point's id");
  for (int i = 0; i < 3; ++i) point.position[i] = file.real("a point's position");
  for (std::uint8_t& value : point.colour) value = static_cast<std::uint8_t>(file.whole(1, "a point's colour"));
  point.error = file.real("a point's error");
  return point;
}

void read_binary(const fs::path& folder, bool observations, ColmapModel& model) {
  BinaryFile cameras(folder / "cameras.bin");
  for (auto left = cameras.count(4 + 4 + 8 + 8 + 3 * 8, "cameras"); left > 0; --left) {
    const auto id = cameras.whole(4, "a camera's id"), number = cameras.whole(4, "a camera's model");
    if (number >= std::size(kLenses)) unknown_lens(std::to_string(number), cameras);
    add_camera(model, id, kLenses[number], cameras);
  }
  cameras.end();
  BinaryFile images(folder / "images.bin");
  for (auto left = images.count(4 + 7 * 8 + 4 + 1 + 8, "images"); left > 0; --left) {
    images.whole(4, "an image's id");
    model.images.push_back(image_of(images));
    const auto count = images.count(3 * 8, "points in an image");
    if (!observations) images.skip(count * 3 * 8, "points in an image");
    for (std::uint64_t i = 0; observations && i < count; ++i) {
      const ColmapObservation found = observation_of(images);
      if (found.point != kNoPoint) model.images.back().observations.push_back(found);
    }
  }
  images.end();
  if (!has_file(folder / "points3D.bin")) return;
  BinaryFile points(folder / "points3D.bin");
  for (auto left = points.count(8 + 3 * 8 + 3 + 8 + 8, "points"); left > 0; --left) {
    model.points.push_back(point_of(points));
    model.points.back().track = points.count(4 + 4, "images of a point");
    points.skip(model.points.back().track * (4 + 4), "images of a point");
  }
  points.end();
}

void read_text_cameras(const fs::path& path, ColmapModel& model) {
  TextFile cameras(path);
  while (cameras.next()) {
    const std::uint64_t id = cameras.whole(4, "a camera's id");
    const std::string name = cameras.word();
    const auto lens =
        std::find_if(std::begin(kLenses), std::end(kLenses), [&](const Lens& known) { return name == known.name; });
    if (lens == std::end(kLenses)) unknown_lens(printable(name), cameras);
    add_camera(model, id, *lens, cameras);
    cameras.end_line();
  }
}

void read_text_images(const fs::path& path, bool observations, ColmapModel& model) {
  TextFile images(path);
  while (images.next()) {
    images.whole(4, "an image's id");
    model.images.push_back(image_of(images));
    for (images.next_line(); images.more();) {
      const ColmapObservation found = observation_of(images);
      if (observations && found.point != kNoPoint) model.images.back().observations.push_back(found);
    }
  }
}

void read_text_points(const fs::path& path, ColmapModel& model) {
  TextFile points(path);
  while (points.next()) {
    ColmapPoint point = point_of(points);
    for (; points.more(); ++point.track) {
      points.whole(4, "an image of a point");
      points.whole(4, "a point's place in an image");
    }
    model.points.push_back(point);
  }
}

void read_text(const fs::path& folder, bool observations, ColmapModel& model) {
  const fs::path cameras = folder / "cameras.txt", images = folder / "images.txt", points = folder / "points3D.txt";
  without_quotes(cameras, [&] { read_text_cameras(cameras, model); });
  without_quotes(images, [&] { read_text_images(images, observations, model); });
  if (has_file(points)) without_quotes(points, [&] { read_text_points(points, model); });
}

bool has_kind(const fs::path& folder, const char* extension) {
  return is_file(folder / (std::string("cameras") + extension)) &&
         is_file(folder / (std::string("images") + extension));
}

}  // namespace

bool has_colmap_model(const fs::path& folder) { return has_kind(folder, ".bin") || has_kind(folder, ".txt"); }

ColmapModel read_colmap_model(const fs::path& folder, bool observations) {
  ColmapModel model;
  if (has_kind(folder, ".bin")) {
    read_binary(folder, observations, model);
  } else {
    read_text(folder, observations, model);
  }
  return model;
}

Eigen::Matrix4d world_from_camera(const ColmapImage& image, const std::string& where) {
  const double length = image.rotation.norm();
  if (!(length > 1e-6 && length < 1e6)) bad_data(where, ": the quaternion of the pose has length ", length, ", want 1");
  const Eigen::Vector4d unit = image.rotation / length;
  const Eigen::Matrix3d turn = Eigen::Quaterniond(unit[0], unit[1], unit[2], unit[3]).toRotationMatrix().transpose();
  return rigid(pose_from(turn, -turn * image.translation), where);
}

}  // namespace cloam
