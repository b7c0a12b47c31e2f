// Event files by the published formats, read by a reader that shares nothing with the writer.
#include "models/io/tfevents.h"

#include <doctest/doctest.h>

#include <cstring>

using namespace cloam;

namespace {

/// Bit by bit, and masked as tensorflow/core/lib/hash/crc32c.h says.
uint32_t masked(const std::string& bytes) {
  uint32_t sum = 0xffffffff;
  for (const char byte : bytes) {
    sum ^= static_cast<unsigned char>(byte);
    for (int bit = 0; bit < 8; ++bit) sum = sum & 1 ? sum >> 1 ^ 0x82f63b78 : sum >> 1;
  }
  sum = ~sum;
  return ((sum >> 15) | (sum << 17)) + 0xa282ead8;
}

template <class Number>
Number at(const std::string& bytes, std::size_t place) {
  Number value;
  REQUIRE(place + sizeof value <= bytes.size());
  std::memcpy(&value, bytes.data() + place, sizeof value);
  return value;
}

/// The messages of a file, each checksum held against our own.
std::vector<std::string> messages_of(const std::string& file) {
  std::vector<std::string> messages;
  for (std::size_t place = 0; place < file.size();) {
    const auto length = at<uint64_t>(file, place);
    CHECK(at<uint32_t>(file, place + 8) == masked(file.substr(place, 8)));
    messages.push_back(file.substr(place + 12, length));
    CHECK(at<uint32_t>(file, place + 12 + length) == masked(messages.back()));
    place += 16 + length;
  }
  return messages;
}

struct Field {
  uint64_t number, integer;
  std::string bytes;  // of wire types 1, 2 and 5
};

std::vector<Field> fields_of(const std::string& message) {
  std::vector<Field> fields;
  std::size_t place = 0;
  const auto varint = [&] {
    uint64_t value = 0;
    for (int shift = 0;; shift += 7) {
      const auto byte = static_cast<unsigned char>(message.at(place++));
      value |= uint64_t{byte & 127u} << shift;
      if (byte < 128) return value;
    }
  };
  while (place < message.size()) {
    const uint64_t key = varint(), wire = key & 7;
    Field field{key >> 3, 0, {}};
    if (wire == 0) {
      field.integer = varint();
    } else {
      const std::size_t length = wire == 1 ? 8 : wire == 5 ? 4 : varint();
      REQUIRE(place + length <= message.size());
      field.bytes = message.substr(place, length);
      place += length;
    }
    fields.push_back(field);
  }
  return fields;
}

}  // namespace

TEST_CASE("an event file begins with the bytes that TensorFlow's begin with") {
  const std::string start = event_file_start(1.5);
  CHECK(start.substr(0, 13) == std::string("\x18\0\0\0\0\0\0\0\xa3\x7f\x4b\x22\x09", 13));
  const auto messages = messages_of(start);
  REQUIRE(messages.size() == 1);
  const auto fields = fields_of(messages.front());
  REQUIRE(fields.size() == 2);
  CHECK(fields[0].number == 1);  // wall_time
  CHECK(at<double>(fields[0].bytes, 0) == 1.5);
  CHECK(fields[1].number == 3);  // file_version
  CHECK(fields[1].bytes == "brain.Event:2");
}

TEST_CASE("scalars, pictures and restarts are the fields of event.proto and summary.proto") {
  const std::vector<std::uint8_t> png(300, 0x89);
  const auto messages = messages_of(event_scalars({2, 300}, {{"train/loss", 0.25}, {"train/psnr", -3}}) +
                                    event_picture({3, 70000}, "preview", png, 640, 480) + event_restart({4, 301}));
  REQUIRE(messages.size() == 3);
  const auto scalars = fields_of(messages[0]);
  REQUIRE(scalars.size() == 3);
  CHECK(scalars[1].number == 2);  // step
  CHECK(scalars[1].integer == 300);
  CHECK(scalars[2].number == 5);  // summary
  const auto values = fields_of(scalars[2].bytes);
  REQUIRE(values.size() == 2);
  const auto loss = fields_of(values[0].bytes), psnr = fields_of(values[1].bytes);
  CHECK(loss.at(0).bytes == "train/loss");  // tag
  CHECK(loss.at(1).number == 2);            // simple_value
  CHECK(at<float>(loss.at(1).bytes, 0) == 0.25f);
  CHECK(at<float>(psnr.at(1).bytes, 0) == -3.f);
  const auto picture = fields_of(messages[1]);
  CHECK(picture.at(1).integer == 70000);
  const auto value = fields_of(fields_of(picture.at(2).bytes).at(0).bytes);
  CHECK(value.at(0).bytes == "preview");
  CHECK(value.at(1).number == 4);  // image
  const auto image = fields_of(value.at(1).bytes);
  CHECK(image.at(0).integer == 480);
  CHECK(image.at(1).integer == 640);
  CHECK(image.at(2).integer == 3);  // RGB
  CHECK(image.at(3).bytes == std::string(png.begin(), png.end()));
  const auto restart = fields_of(messages[2]);
  CHECK(restart.at(1).integer == 301);
  CHECK(restart.at(2).number == 7);                          // session_log
  CHECK(fields_of(restart.at(2).bytes).at(0).integer == 1);  // START
}
