// The records of an event file, from which TensorBoard draws curves and pictures: TFRecord framing around protocol
// buffers (tensorflow/core/util/event.proto, framework/summary.proto), of which a few fields are enough.
#pragma once
#include <cstdint>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace cloam {

/// When and at which step something was measured. time: seconds since 1970, UTC.
struct EventMoment {
  double time = 0;
  int64_t step = 0;
};

/// Each returns whole records: bytes to append to the file.
/// The first record of every file.
std::string event_file_start(double time);
/// For the file of a training that goes on: what earlier files say of this step and later ones no longer holds.
std::string event_restart(const EventMoment& first);
std::string event_scalars(const EventMoment& when, const std::vector<std::pair<std::string, double>>& values);
/// png: a whole file.
std::string event_picture(const EventMoment& when, const std::string& tag, std::span<const std::uint8_t> png, int width,
                          int height);

}  // namespace cloam
