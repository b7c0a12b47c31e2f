// See compressed_ply.h.
#include "models/gaussians/compressed_ply.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <fstream>
#include <numbers>
#include <numeric>

#include "models/gaussians/gaussian_ply.h"
#include "models/gaussians/values.h"
#include "models/io/bytes.h"
#include "models/io/words.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr std::uint64_t kMostBytes = std::uint64_t{1} << 32;
constexpr std::size_t kChunk = 256;     // gaussians
constexpr std::size_t kBounds = 18;     // of a chunk: least and most of position, logarithm of scale, colour
constexpr std::size_t kWordBytes = 16;  // of a gaussian
constexpr double kLargestScale = 20;    // logarithm; what the format's own tool writes
constexpr double kHarmonics = 8;        // from -4 to 4
constexpr char kFirstLines[] = "ply\nformat binary_little_endian 1.0\n";

const std::vector<std::string> kBoundNames = {
    "min_x",       "min_y",       "min_z",       "max_x", "max_y", "max_z", "min_scale_x", "min_scale_y", "min_scale_z",
    "max_scale_x", "max_scale_y", "max_scale_z", "min_r", "min_g", "min_b", "max_r",       "max_g",       "max_b"};
const std::vector<std::string> kWordNames = {"packed_position", "packed_rotation", "packed_scale", "packed_color"};

/// What a word of 32 bits is made of, from the top.
using Widths = std::array<int, 4>;
constexpr Widths kThree = {11, 10, 11, 0}, kColour = {8, 8, 8, 8}, kTurn = {2, 10, 10, 10};

std::uint32_t most_of(int bits) { return (std::uint32_t{1} << bits) - 1; }

std::uint32_t packed(const std::array<std::uint32_t, 4>& parts, const Widths& widths) {
  std::uint32_t word = 0;
  for (std::size_t i = 0; i < 4; ++i)
    if (widths[i] > 0) word = word << widths[i] | parts[i];
  return word;
}

std::array<std::uint32_t, 4> unpacked(std::uint32_t word, const Widths& widths) {
  std::array<std::uint32_t, 4> parts{};
  for (std::size_t i = 4; i-- > 0;) {
    parts[i] = word & most_of(widths[i]);
    word >>= widths[i];
  }
  return parts;
}

/// From least to most as all values of so many bits.
struct StepRange {
  double least = 0, most = 1;
  double value(std::uint32_t part, int bits) const { return least + (most - least) * part / most_of(bits); }
  std::uint32_t part(double value, int bits) const {
    if (!(most > least)) return 0;
    const double share = std::clamp((value - least) / (most - least), 0.0, 1.0);
    return static_cast<std::uint32_t>(std::lround(share * most_of(bits)));
  }
};

using Ranges = std::array<StepRange, 9>;  // of a chunk: positions, scales, colours

double colour_of(float first) { return 0.5 + kSphericalFirst * static_cast<double>(first); }
double kept_scale(float scale) { return std::clamp(static_cast<double>(scale), -kLargestScale, kLargestScale); }

std::array<double, 9> ranged_values(const Gaussians& gaussians, std::size_t g) {
  std::array<double, 9> values;
  for (std::size_t i = 0; i < 3; ++i) {
    values[i] = static_cast<double>(gaussians.means[3 * g + i]);
    values[3 + i] = kept_scale(gaussians.scales[3 * g + i]);
    values[6 + i] = colour_of(gaussians.sh_first[3 * g + i]);
  }
  return values;
}

/// As floats have them, so that writer and reader see the same.
Ranges ranges_of(const Gaussians& gaussians, std::span<const std::size_t> places) {
  Ranges ranges;
  for (StepRange& range : ranges)
    range = {std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()};
  for (const std::size_t g : places) {
    const std::array<double, 9> values = ranged_values(gaussians, g);
    for (std::size_t i = 0; i < 9; ++i)
      ranges[i] = {std::min(ranges[i].least, values[i]), std::max(ranges[i].most, values[i])};
  }
  for (StepRange& range : ranges)
    range = {static_cast<double>(static_cast<float>(range.least)), static_cast<double>(static_cast<float>(range.most))};
  return ranges;
}

/// Which of w x y z is the largest (2 bits), then the others in this order, from -sqrt(1/2) to sqrt(1/2).
constexpr StepRange kOfTurn{-std::numbers::sqrt2 / 2, std::numbers::sqrt2 / 2};

std::uint32_t pack_rotation(const float* wxyz) {
  const Eigen::Vector4d q = Eigen::Map<const Eigen::Vector4f>(wxyz).cast<double>().normalized();
  Eigen::Index largest;
  q.cwiseAbs().maxCoeff(&largest);
  std::array<std::uint32_t, 4> parts{static_cast<std::uint32_t>(largest)};
  std::size_t next = 1;
  for (Eigen::Index i = 0; i < 4; ++i)
    if (i != largest) parts[next++] = kOfTurn.part(q[largest] < 0 ? -q[i] : q[i], 10);
  return packed(parts, kTurn);
}

void unpack_rotation(std::uint32_t word, float* wxyz) {
  const std::array<std::uint32_t, 4> parts = unpacked(word, kTurn);
  double rest = 1;
  std::size_t next = 1;
  for (std::uint32_t i = 0; i < 4; ++i) {
    if (i == parts[0]) continue;
    const double value = kOfTurn.value(parts[next++], 10);
    wxyz[i] = static_cast<float>(value);
    rest -= value * value;
  }
  wxyz[parts[0]] = static_cast<float>(std::sqrt(std::max(0.0, rest)));
}

std::array<std::uint32_t, 4> words_of(const Gaussians& gaussians, std::size_t g, const Ranges& ranges) {
  const std::array<double, 9> values = ranged_values(gaussians, g);
  std::array<std::uint32_t, 4> position{}, scale{}, colour{};
  for (std::size_t i = 0; i < 3; ++i) {
    position[i] = ranges[i].part(values[i], kThree[i]);
    scale[i] = ranges[3 + i].part(values[3 + i], kThree[i]);
    colour[i] = ranges[6 + i].part(values[6 + i], kColour[i]);
  }
  colour[3] = byte_of_logit(gaussians.opacities[g]);
  return {packed(position, kThree), pack_rotation(&gaussians.rotations[4 * g]), packed(scale, kThree),
          packed(colour, kColour)};
}

void take_words(const std::array<std::uint32_t, 4>& words, const Ranges& ranges, Gaussians& gaussians, std::size_t g) {
  const auto position = unpacked(words[0], kThree), scale = unpacked(words[2], kThree),
             colour = unpacked(words[3], kColour);
  for (std::size_t i = 0; i < 3; ++i) {
    gaussians.means[3 * g + i] = static_cast<float>(ranges[i].value(position[i], kThree[i]));
    gaussians.scales[3 * g + i] = static_cast<float>(ranges[3 + i].value(scale[i], kThree[i]));
    gaussians.sh_first[3 * g + i] =
        static_cast<float>((ranges[6 + i].value(colour[i], kColour[i]) - 0.5) / kSphericalFirst);
  }
  gaussians.opacities[g] = logit_of_byte(static_cast<std::uint8_t>(colour[3]));
  unpack_rotation(words[1], &gaussians.rotations[4 * g]);
}

/// The ends stand for themselves, all else for the middle of its step.
float harmonic_of(std::uint8_t byte) {
  const double share = byte == 0 ? 0 : byte == 255 ? 1 : (byte + 0.5) / 256;
  return static_cast<float>((share - 0.5) * kHarmonics);
}

std::uint8_t byte_of_harmonic(float value) {
  return static_cast<std::uint8_t>(std::clamp(256 * (static_cast<double>(value) / kHarmonics + 0.5), 0.0, 255.0));
}

/// The place in sh_rest of the property f_rest_i, which go channel by channel.
std::size_t rest_place(std::size_t i, std::size_t coefficients) { return 3 * (i % coefficients) + i / coefficients; }

struct ChunkedElement {
  std::string name;
  std::uint64_t count = 0;
  std::vector<std::string> names;
  std::string type;  // of all its properties; "mixed" if they differ
};

struct ChunkedHeader {
  std::vector<std::string> comments;
  std::vector<ChunkedElement> elements;
};

class ChunkedReader {
 public:
  ChunkedReader(const std::vector<std::uint8_t>& bytes, const std::string& file) : bytes_(bytes, file), file_(file) {}

  SplatFile read() {
    read_header();
    check_elements();
    const std::size_t count = layout_.elements[1].count, bounds = layout_.elements[0].names.size();
    SplatFile out{zero_gaussians(count, file_), {}};
    take_comments(layout_.comments, out.gaussians);
    const auto chunks = bytes_.take(layout_.elements[0].count * bounds * sizeof(float), "the bounds of chunks");
    const auto words = bytes_.take(count * kWordBytes, "packed Gaussians");
    for (std::size_t g = 0; g < count; ++g) {
      const std::uint8_t* at = &words[g * kWordBytes];
      take_words({number_at<std::uint32_t>(at), number_at<std::uint32_t>(at + 4), number_at<std::uint32_t>(at + 8),
                  number_at<std::uint32_t>(at + 12)},
                 ranges_at(&chunks[g / kChunk * bounds * sizeof(float)], bounds), out.gaussians, g);
    }
    if (layout_.elements.size() == 3) read_harmonics(out.gaussians);
    return out;
  }

 private:
  [[noreturn]] void fail(const std::string& why) const { bad_data(file_, ": ", why); }

  std::string line() {
    constexpr std::size_t kLongest = 4096;
    std::string found;
    do {
      if (found.size() == kLongest) fail("the header has a line without an end");
      found += static_cast<char>(bytes_.take(1, "the header")[0]);
    } while (found.back() != '\n');
    return found.substr(0, found.find_last_not_of("\r\n") + 1);
  }

  void read_header() {
    line(), line();
    for (std::string found = line(); found != "end_header"; found = line()) {
      std::string_view rest = found;
      const std::string_view word = next_word(rest);
      if (word == "comment") {
        layout_.comments.emplace_back(rest.substr(std::min(rest.find_first_not_of(' '), rest.size())));
      } else if (word == "element") {
        const std::string name(next_word(rest));
        layout_.elements.push_back({name, number_in<std::uint64_t>(next_word(rest)).value_or(0), {}, ""});
      } else if (word == "property" && !layout_.elements.empty()) {
        ChunkedElement& element = layout_.elements.back();
        const std::string type(next_word(rest));
        element.type = element.type.empty() || element.type == type ? type : "mixed";
        element.names.emplace_back(next_word(rest));
      }
    }
  }

  bool has(std::size_t index, const char* name, const char* type, const std::vector<std::string>& names) const {
    const ChunkedElement& element = layout_.elements[index];
    return element.name == name && element.type == type && element.names.size() <= names.size() &&
           std::equal(element.names.begin(), element.names.end(), names.begin());
  }

  void check_elements() const {
    const std::vector<ChunkedElement>& all = layout_.elements;
    if (all.size() < 2 || !has(0, "chunk", "float", kBoundNames) || !has(1, "vertex", "uint", kWordNames) ||
        (all[0].names.size() != 12 && all[0].names.size() != kBounds) || all[1].names.size() != kWordNames.size())
      fail(
          "is a .ply with chunks, but none of PlayCanvas's: want chunk with min_x to max_scale_z (float), vertex with "
          "packed_position, packed_rotation, packed_scale and packed_color (uint)\n  fix: save it as a plain .ply");
    check_count(all[1].count, file_);
    if (all[0].count != (all[1].count + kChunk - 1) / kChunk)
      fail(text(all[1].count, " Gaussians have ", all[0].count, " chunks, want one for each 256"));
    if (all.size() == 2) return;
    const std::size_t rest = all[2].names.size();
    if (all.size() > 3 || all[2].name != "sh" || all[2].type != "uchar" || all[2].count != all[1].count ||
        (rest != 9 && rest != 24 && rest != 45))
      fail("its harmonics are not those of PlayCanvas: want an element sh with 9, 24 or 45 properties (uchar)");
  }

  static Ranges ranges_at(const std::uint8_t* bytes, std::size_t bounds) {
    Ranges ranges;
    for (std::size_t i = 0; i < bounds / 2; ++i) {
      const std::size_t least = i / 3 * 6 + i % 3;
      ranges[i] = {static_cast<double>(number_at<float>(bytes + 4 * least)),
                   static_cast<double>(number_at<float>(bytes + 4 * (least + 3)))};
    }
    return ranges;
  }

  void read_harmonics(Gaussians& gaussians) {
    const std::size_t numbers = layout_.elements[2].names.size();
    const auto bytes = bytes_.take(gaussians.count() * numbers, "harmonics");
    for (std::size_t g = 0; g < gaussians.count(); ++g)
      for (std::size_t i = 0; i < numbers; ++i)
        gaussians.sh_rest[3 * kSphericalRest * g + rest_place(i, numbers / 3)] = harmonic_of(bytes[g * numbers + i]);
  }

  ByteReader bytes_;
  std::string file_;
  ChunkedHeader layout_;
};

std::string compressed_header(const Gaussians& gaussians, std::size_t coefficients) {
  std::string header = kFirstLines;
  for (const std::string& comment : comments_of(gaussians)) header += "comment " + comment + "\n";
  const auto element = [&](const char* name, std::size_t count, const char* type, const auto& names) {
    header += text("element ", name, " ", count, "\n");
    for (const auto& property : names) header += text("property ", type, " ", property, "\n");
  };
  element("chunk", (gaussians.count() + kChunk - 1) / kChunk, "float", kBoundNames);
  element("vertex", gaussians.count(), "uint", kWordNames);
  std::vector<std::string> rest;
  for (std::size_t i = 0; i < 3 * coefficients; ++i) rest.push_back(text("f_rest_", i));
  if (!rest.empty()) element("sh", gaussians.count(), "uchar", rest);
  return header + "end_header\n";
}

void check_finite(const std::filesystem::path& path, const Gaussians& gaussians) {
  for (const GaussianArray& array : kGaussianArrays)
    for (const float value : gaussians.*array.values)
      if (!std::isfinite(value) && array.values != &Gaussians::opacities)
        bad_data(path.string(), ": the Gaussians' ", array.name, " are not all finite, which this format cannot hold");
}

/// Every third bit, for the numbers of a place on Morton's curve.
std::uint64_t spread(std::uint64_t bits) {
  std::uint64_t out = 0;
  for (int i = 0; i < 21; ++i) out |= (bits >> i & 1) << (3 * i);
  return out;
}

template <class Value>
void hand(const ByteSink& sink, std::span<const Value> values) {
  sink(std::as_bytes(values));
}

}  // namespace

bool is_compressed_ply(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::string line;
  for (int lines = 0; lines < 64 && std::getline(file, line) && line.size() < 4096; ++lines)
    if (line.starts_with("element ")) return line.starts_with("element chunk ");
  return false;
}

SplatFile read_compressed_ply(const std::filesystem::path& path) {
  return ChunkedReader(read_file(path, kMostBytes), path.string()).read();
}

std::vector<std::size_t> compressed_order(const Gaussians& gaussians) {
  std::vector<std::size_t> order(gaussians.count());
  std::iota(order.begin(), order.end(), std::size_t{0});
  const Ranges all = ranges_of(gaussians, order);
  std::vector<std::uint64_t> places;
  for (const std::size_t g : order) {
    std::uint64_t place = 0;
    for (std::size_t i = 0; i < 3; ++i)
      place |= spread(all[i].part(static_cast<double>(gaussians.means[3 * g + i]), 21)) << i;
    places.push_back(place);
  }
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return places[a] < places[b]; });
  return order;
}

void write_compressed_ply(const std::filesystem::path& path, const Gaussians& gaussians) {
  check_finite(path, gaussians);
  const std::vector<std::size_t> order = compressed_order(gaussians);
  const std::size_t coefficients = rest_of_degree(degree_of(gaussians));
  std::vector<float> bounds;
  std::vector<std::uint32_t> words;
  for (std::size_t first = 0; first < order.size(); first += kChunk) {
    const auto chunk = std::span<const std::size_t>(order).subspan(first, std::min(kChunk, order.size() - first));
    const Ranges ranges = ranges_of(gaussians, chunk);
    for (std::size_t part = 0; part < 9; part += 3) {
      for (std::size_t i = 0; i < 3; ++i) bounds.push_back(static_cast<float>(ranges[part + i].least));
      for (std::size_t i = 0; i < 3; ++i) bounds.push_back(static_cast<float>(ranges[part + i].most));
    }
    for (const std::size_t g : chunk)
      for (const std::uint32_t word : words_of(gaussians, g, ranges)) words.push_back(word);
  }
  std::vector<std::uint8_t> harmonics;
  for (const std::size_t g : order)
    for (std::size_t i = 0; i < 3 * coefficients; ++i)
      harmonics.push_back(byte_of_harmonic(gaussians.sh_rest[3 * kSphericalRest * g + rest_place(i, coefficients)]));
  commit_stream(path, [&](const ByteSink& sink) {
    hand(sink, std::span<const char>(compressed_header(gaussians, coefficients)));
    hand(sink, std::span<const float>(bounds));
    hand(sink, std::span<const std::uint32_t>(words));
    hand(sink, std::span<const std::uint8_t>(harmonics));
  });
}

}  // namespace cloam
