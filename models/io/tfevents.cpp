// See tfevents.h. Protocol buffers: a field is a varint of (number << 3 | wire type), then its value; wire types are
// 0 varint, 1 eight bytes, 2 a length and so many bytes, 5 four bytes. Default values are left out.
#include "models/io/tfevents.h"

#include <cstring>

#include "models/io/crc32c.h"

namespace cloam {
namespace {

enum Wire : uint32_t { varint = 0, eight_bytes = 1, counted = 2, four_bytes = 5 };

// Field numbers: Event.
constexpr uint32_t kWallTime = 1, kStep = 2, kFileVersion = 3, kSummary = 5, kSessionLog = 7;
// Summary, Summary.Value, Summary.Image, SessionLog.
constexpr uint32_t kValue = 1, kTag = 1, kSimpleValue = 2, kImage = 4;
constexpr uint32_t kHeight = 1, kWidth = 2, kColourSpace = 3, kEncoded = 4, kRgb = 3;
constexpr uint32_t kStatus = 1, kStart = 1;

template <class Number>
std::string bytes_of(Number value) {
  std::string bytes(sizeof value, '\0');
  std::memcpy(bytes.data(), &value, sizeof value);  // little-endian, as every host that we build for
  return bytes;
}

std::string varint_of(uint64_t value) {
  std::string bytes;
  for (; value >= 128; value >>= 7) bytes += static_cast<char>(value | 128);
  return bytes + static_cast<char>(value);
}

std::string key(uint32_t number, Wire wire) { return varint_of(number << 3 | wire); }
std::string field(uint32_t number, uint64_t value) { return value == 0 ? "" : key(number, varint) + varint_of(value); }
std::string field(uint32_t number, const std::string& bytes) {
  return key(number, counted) + varint_of(bytes.size()) + bytes;
}

uint32_t masked_checksum(const std::string& bytes) {
  const uint32_t sum = crc32c(std::as_bytes(std::span(bytes)));
  return (sum >> 15 | sum << 17) + 0xa282ead8u;
}

/// Length, its checksum, the message, its checksum.
std::string record(const std::string& message) {
  const std::string length = bytes_of(static_cast<uint64_t>(message.size()));
  return length + bytes_of(masked_checksum(length)) + message + bytes_of(masked_checksum(message));
}

std::string event(const EventMoment& when, const std::string& what) {
  return record(key(kWallTime, eight_bytes) + bytes_of(when.time) + field(kStep, static_cast<uint64_t>(when.step)) +
                what);
}

}  // namespace

std::string event_file_start(double time) { return event({time, 0}, field(kFileVersion, "brain.Event:2")); }

std::string event_restart(const EventMoment& first) { return event(first, field(kSessionLog, field(kStatus, kStart))); }

std::string event_scalars(const EventMoment& when, const std::vector<std::pair<std::string, double>>& values) {
  std::string summary;
  for (const auto& [tag, value] : values)
    summary += field(kValue, field(kTag, tag) + key(kSimpleValue, four_bytes) + bytes_of(static_cast<float>(value)));
  return event(when, field(kSummary, summary));
}

std::string event_picture(const EventMoment& when, const std::string& tag, std::span<const std::uint8_t> png, int width,
                          int height) {
  const std::string image = field(kHeight, static_cast<uint64_t>(height)) +
                            field(kWidth, static_cast<uint64_t>(width)) + field(kColourSpace, uint64_t{kRgb}) +
                            field(kEncoded, std::string(png.begin(), png.end()));
  return event(when, field(kSummary, field(kValue, field(kTag, tag) + field(kImage, image))));
}

}  // namespace cloam
