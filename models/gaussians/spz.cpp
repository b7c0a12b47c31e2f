// See spz.h.
#include "models/gaussians/spz.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <numbers>

#include "models/gaussians/turn.h"
#include "models/gaussians/values.h"
#include "models/io/bytes.h"
#include "models/io/commit.h"
#include "models/io/gzip.h"
#include "runtime/error.h"

namespace cloam {
namespace {

using Bytes = std::vector<std::uint8_t>;
using Section = std::span<const std::uint8_t>;
using Eigen::Vector4d;

constexpr std::uint64_t kMaxSpzBytes = std::uint64_t{1} << 31;
constexpr int kMaxFractionBits = 16, kPositionBits = 24;
constexpr std::uint8_t kAntialiased = 1, kHasExtensions = 2;
constexpr int kHighestDegree = 4;
constexpr double kColourScale = 0.15 * 255, kColourZero = 0.5 * 255;  // bytes of a first coefficient
constexpr double kScaleSteps = 16, kScaleZero = -10;                  // bytes of a logarithm
constexpr double kRestSteps = 128, kRestZero = 128;                   // bytes of a further coefficient
constexpr double kFirstThreeHalf = 127.5;
constexpr std::uint32_t kMagnitudeBits = 9, kMagnitude = (1u << kMagnitudeBits) - 1;

struct Header {
  std::array<char, 4> magic{'N', 'G', 'S', 'P'};
  std::uint32_t version = 3, count = 0;
  std::uint8_t degree = 0, fraction_bits = 0, flags = 0, reserved = 0;
};
static_assert(sizeof(Header) == 16);

std::size_t rotation_bytes(const Header& header) { return header.version == 2 ? 3 : 4; }

[[noreturn]] void fail(const std::string& file, const std::string& why) { bad_data(file + ": " + why); }

Header read_header(ByteReader& reader, const std::string& file) {
  Header header;
  std::memcpy(&header, reader.take(sizeof header, "the header of an .spz").data(), sizeof header);
  if (header.magic != Header().magic) fail(file, "is not an .spz file: it does not begin with NGSP");
  if (header.version != 2 && header.version != 3) {
    fail(file,
         text("is .spz version ", header.version, ", supported are 2 and 3: save it as one of these, ", "or as .ply"));
  }
  if (header.degree > kHighestDegree) fail(file, text("has harmonics of degree ", int(header.degree), ", want 0 to 4"));
  if (header.fraction_bits > kPositionBits) {
    fail(file, text("has positions with ", int(header.fraction_bits), " bits after the point, want 0 to 24"));
  }
  const std::uint64_t bytes = 9 + 1 + 3 + 3 + rotation_bytes(header) + 3 * rest_of_degree(header.degree);
  if (header.count > reader.remaining() / bytes) {
    fail(file, text("is truncated: ", header.count, " Gaussians of ", bytes, " bytes are declared, ",
                    reader.remaining(), " bytes follow the header"));
  }
  const std::uint64_t after = reader.remaining() - header.count * bytes;
  if (after > 0 && !(header.flags & kHasExtensions)) {
    fail(file, text(after, " bytes follow the ", header.count, " Gaussians that it declares; is it damaged?"));
  }
  return header;
}

// 24 bits, the lowest byte first, negative numbers as two's complement.
double fixed_point(const std::uint8_t* bytes) {
  const std::uint32_t bits =
      bytes[0] | static_cast<std::uint32_t>(bytes[1]) << 8 | static_cast<std::uint32_t>(bytes[2]) << 16;
  return bits < (1u << 23) ? double(bits) : double(bits) - double(1u << 24);
}

// Version 2: x y z of the rotation with w >= 0; w follows from the length 1.
Vector4d first_three(const std::uint8_t* bytes) {
  Vector4d xyzw;
  for (int i = 0; i < 3; ++i) xyzw[i] = bytes[i] / kFirstThreeHalf - 1;
  xyzw[3] = std::sqrt(std::max(0.0, 1 - xyzw.head<3>().squaredNorm()));
  return xyzw;
}

// Version 3: which of x y z w is the largest (2 bits, the highest), then the others in this order, each a sign and 9
// bits of magnitude in units of sqrt(1/2) / 511, since no other can exceed sqrt(1/2).
Vector4d smallest_three(const std::uint8_t* bytes) {
  std::uint32_t bits;
  std::memcpy(&bits, bytes, sizeof bits);
  const auto largest = static_cast<int>(bits >> 30);
  Vector4d xyzw = Vector4d::Zero();
  for (int i = 3; i >= 0; --i) {
    if (i == largest) continue;
    const double magnitude = std::numbers::sqrt2 / 2 * (bits & kMagnitude) / kMagnitude;
    xyzw[i] = bits >> kMagnitudeBits & 1 ? -magnitude : magnitude;
    bits >>= kMagnitudeBits + 1;
  }
  xyzw[largest] = std::sqrt(std::max(0.0, 1 - xyzw.squaredNorm()));
  return xyzw;
}

void unpack_rotations(const Header& header, Section bytes, Gaussians& gaussians) {
  for (std::size_t g = 0; g < header.count; ++g) {
    const std::uint8_t* at = bytes.data() + g * rotation_bytes(header);
    const Vector4d xyzw = header.version == 2 ? first_three(at) : smallest_three(at);
    for (std::size_t i = 0; i < 4; ++i) {
      gaussians.rotations[4 * g + i] = static_cast<float>(xyzw[static_cast<Eigen::Index>((i + 3) % 4)]);
    }
  }
}

void unpack_rest(const Header& header, Section bytes, Gaussians& gaussians) {
  const std::size_t stored = 3 * rest_of_degree(header.degree),
                    kept = std::min<std::size_t>(stored, 3 * kSphericalRest);
  for (std::size_t g = 0; g < header.count; ++g) {
    for (std::size_t i = 0; i < kept; ++i) {
      gaussians.sh_rest[3 * kSphericalRest * g + i] =
          static_cast<float>((bytes[g * stored + i] - kRestZero) / kRestSteps);
    }
  }
}

SplatFile unpack(const Bytes& bytes, const std::string& file) {
  ByteReader reader(bytes, file);
  const Header header = read_header(reader, file);
  SplatFile result{zero_gaussians(header.count, file), {}};
  Gaussians& gaussians = result.gaussians;
  const std::uint64_t count = header.count;
  const Section positions = reader.take(9 * count, "positions"), opacities = reader.take(count, "opacities");
  const Section colours = reader.take(3 * count, "colours"), scales = reader.take(3 * count, "scales");
  const double unit = std::ldexp(1.0, -header.fraction_bits);
  for (std::size_t i = 0; i < 3 * count; ++i) {
    gaussians.means[i] = static_cast<float>(unit * fixed_point(&positions[3 * i]));
    gaussians.sh_first[i] = static_cast<float>((colours[i] - kColourZero) / kColourScale);
    gaussians.scales[i] = static_cast<float>(scales[i] / kScaleSteps + kScaleZero);
  }
  std::transform(opacities.begin(), opacities.end(), gaussians.opacities.begin(), logit_of_byte);
  unpack_rotations(header, reader.take(rotation_bytes(header) * count, "rotations"), gaussians);
  unpack_rest(header, reader.take(3 * rest_of_degree(header.degree) * count, "harmonics"), gaussians);
  gaussians.up = Eigen::Vector3d::UnitY();
  const auto warn = [&](const char* what) { result.warnings.push_back(file + ": " + what); };
  if (header.degree > kSphericalBands) warn("spherical harmonics of degree 4 left out");
  if (header.flags & kAntialiased) warn("was trained with anti-aliasing, and looks right only when rendered with it");
  if (header.flags & kHasExtensions) warn("has extensions, which are ignored");
  return result;
}

int fraction_bits_for(const Gaussians& gaussians, const std::string& file) {
  double farthest = 0;
  for (const float value : gaussians.means) farthest = std::max(farthest, std::abs(double(value)));
  for (int bits = kMaxFractionBits; bits >= 0; --bits) {
    if (std::ldexp(farthest, bits) < (1 << (kPositionBits - 1)) - 1) return bits;
  }
  fail(file, text("a Gaussian lies at ", farthest,
                  ", which an .spz cannot hold: remove what is that far away, or write a ", ".ply"));
}

void pack_position(double value, int fraction_bits, Bytes& bytes) {
  const auto fixed = static_cast<std::uint32_t>(std::lround(std::ldexp(value, fraction_bits)));
  for (int shift = 0; shift < kPositionBits; shift += 8) bytes.push_back(static_cast<std::uint8_t>(fixed >> shift));
}

Vector4d unit_rotation(const Gaussians& gaussians, std::size_t g) {
  const float* q = &gaussians.rotations[4 * g];
  return Vector4d(q[1], q[2], q[3], q[0]).normalized();
}

void pack_first_three(const Vector4d& xyzw, Bytes& bytes) {
  const double sign = xyzw[3] < 0 ? -1 : 1;  // q and -q are one rotation
  for (int i = 0; i < 3; ++i) bytes.push_back(to_byte(kFirstThreeHalf + kFirstThreeHalf * sign * xyzw[i]));
}

void pack_smallest_three(const Vector4d& xyzw, Bytes& bytes) {
  Eigen::Index largest;
  xyzw.cwiseAbs().maxCoeff(&largest);
  auto bits = static_cast<std::uint32_t>(largest);
  for (Eigen::Index i = 0; i < 4; ++i) {
    if (i == largest) continue;
    const bool negative = (xyzw[i] < 0) != (xyzw[largest] < 0);
    const auto magnitude =
        static_cast<std::uint32_t>(std::lround(kMagnitude * std::numbers::sqrt2 * std::abs(xyzw[i])));
    bits = bits << (kMagnitudeBits + 1) | (negative ? kMagnitude + 1 : 0) | std::min(magnitude, kMagnitude);
  }
  for (int shift = 0; shift < 32; shift += 8) bytes.push_back(static_cast<std::uint8_t>(bits >> shift));
}

// To the middle of a bucket of 8 (degree 1) or 16 steps, which gzip makes small; 0 stays 0.
std::uint8_t pack_rest(float value, std::size_t coefficient) {
  const int bucket = coefficient < rest_of_degree(1) ? 8 : 16;
  return to_byte(kRestZero + bucket * std::round(double(value) * kRestSteps / bucket));
}

Bytes pack(const Gaussians& gaussians, int version, const std::string& file) {
  const std::size_t count = gaussians.count();
  Header header;
  header.version = static_cast<std::uint32_t>(version);
  header.count = static_cast<std::uint32_t>(count);
  header.degree = static_cast<std::uint8_t>(degree_of(gaussians));
  header.fraction_bits = static_cast<std::uint8_t>(fraction_bits_for(gaussians, file));
  const std::size_t coefficients = rest_of_degree(header.degree);
  const std::uint64_t size = sizeof header + count * (16 + rotation_bytes(header) + 3 * coefficients);
  if (size >= kMaxSpzBytes) fail(file, text(count, " Gaussians are too many for an .spz: write a .ply"));
  Bytes bytes(sizeof header);
  bytes.reserve(size);
  std::memcpy(bytes.data(), &header, sizeof header);
  for (const float value : gaussians.means) pack_position(double(value), header.fraction_bits, bytes);
  for (const float value : gaussians.opacities) bytes.push_back(byte_of_logit(value));
  for (const float value : gaussians.sh_first) bytes.push_back(to_byte(kColourZero + kColourScale * double(value)));
  for (const float value : gaussians.scales) bytes.push_back(to_byte((double(value) - kScaleZero) * kScaleSteps));
  for (std::size_t g = 0; g < count; ++g) {
    const Vector4d xyzw = unit_rotation(gaussians, g);
    version == 2 ? pack_first_three(xyzw, bytes) : pack_smallest_three(xyzw, bytes);
  }
  for (std::size_t g = 0; g < count; ++g) {
    for (std::size_t i = 0; i < 3 * coefficients; ++i) {
      bytes.push_back(pack_rest(gaussians.sh_rest[3 * kSphericalRest * g + i], i / 3));
    }
  }
  return bytes;
}

}  // namespace

SplatFile read_spz(const std::filesystem::path& path) {
  const Bytes bytes = read_file(path, kMaxSpzBytes - 1);
  return unpack(is_gzip(bytes) ? gunzip(bytes, kMaxSpzBytes, path.string()) : bytes, path.string());
}

std::vector<std::uint8_t> spz_bytes(const Gaussians& gaussians, int version, const std::string& name) {
  if (version != 2 && version != 3)
    throw Error(Fault::usage, text(name, ": want version 2 or 3 of .spz, not ", version));
  return gzip(pack(turned(gaussians, Eigen::Vector3d::UnitY()), version, name));
}

void write_spz(const std::filesystem::path& path, const Gaussians& gaussians, int version) {
  const Bytes bytes = spz_bytes(gaussians, version, path.string());
  commit_bytes(path, std::as_bytes(std::span<const std::uint8_t>(bytes)));
}

}  // namespace cloam
