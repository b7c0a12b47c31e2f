// See dot_splat.h.
#include "models/gaussians/dot_splat.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "models/gaussians/turn.h"
#include "models/gaussians/values.h"
#include "models/io/bytes.h"
#include "models/io/commit.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr std::uint64_t kMaxSplatBytes = std::uint64_t{1} << 31;
constexpr double kOne = 128;  // bytes of a rotation

struct Record {
  float position[3], deviations[3];
  std::uint8_t colour[3], opacity, rotation[4];
};
static_assert(sizeof(Record) == 32);

void unpack(const Record& record, Gaussians& gaussians, std::size_t g) {
  for (std::size_t i = 0; i < 3; ++i) {
    gaussians.means[3 * g + i] = record.position[i];
    gaussians.scales[3 * g + i] = log_scale(double(record.deviations[i]));
    gaussians.sh_first[3 * g + i] = static_cast<float>((record.colour[i] / 255.0 - 0.5) / kSphericalFirst);
  }
  gaussians.opacities[g] = logit_of_byte(record.opacity);
  for (std::size_t i = 0; i < 4; ++i) {
    gaussians.rotations[4 * g + i] = static_cast<float>((record.rotation[i] - kOne) / kOne);
  }
}

Record pack(const Gaussians& gaussians, std::size_t g) {
  Record record;
  for (std::size_t i = 0; i < 3; ++i) {
    record.position[i] = gaussians.means[3 * g + i];
    record.deviations[i] = std::exp(gaussians.scales[3 * g + i]);
    record.colour[i] = to_byte(255 * (0.5 + kSphericalFirst * double(gaussians.sh_first[3 * g + i])));
  }
  record.opacity = byte_of_logit(gaussians.opacities[g]);
  const Eigen::Vector4d rotation =
      Eigen::Map<const Eigen::Vector4f>(&gaussians.rotations[4 * g]).cast<double>().normalized();
  for (int i = 0; i < 4; ++i) record.rotation[i] = to_byte(kOne + kOne * rotation[i]);
  return record;
}

}  // namespace

SplatFile read_dot_splat(const std::filesystem::path& path) {
  const auto bytes = read_file(path, kMaxSplatBytes);
  if (bytes.empty() || bytes.size() % sizeof(Record) != 0)
    bad_data(path.string(), ": holds ", bytes.size(), " bytes, a .splat has 32 for each of its ",
             "Gaussians; the file is damaged or truncated");
  const std::size_t count = bytes.size() / sizeof(Record);
  SplatFile file{zero_gaussians(count, path.string()), {}};
  for (std::size_t g = 0; g < count; ++g) {
    Record record;
    std::memcpy(&record, bytes.data() + g * sizeof record, sizeof record);
    unpack(record, file.gaussians, g);
  }
  file.gaussians.up = -Eigen::Vector3d::UnitY();
  return file;
}

void write_dot_splat(const std::filesystem::path& path, const Gaussians& given) {
  const Gaussians gaussians = turned(given, -Eigen::Vector3d::UnitY());
  std::vector<Record> records;
  records.reserve(gaussians.count());
  for (std::size_t g = 0; g < gaussians.count(); ++g) records.push_back(pack(gaussians, g));
  commit_bytes(path, std::as_bytes(std::span<const Record>(records)));
}

}  // namespace cloam
