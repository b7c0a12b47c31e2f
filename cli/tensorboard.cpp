// See tensorboard.h.
#include "cli/tensorboard.h"

#include <fmt/format.h>

#include <cerrno>
#include <chrono>
#include <cstring>
#include <nlohmann/json.hpp>

#include "models/io/bytes.h"
#include "models/io/image.h"
#include "models/io/tfevents.h"
#include "models/runs/run_folder.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr uint64_t kLargestEventPicture = 64 << 20;

double seconds_since_1970() {
  return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
}

/// TensorBoard takes the files of a folder by name: this one sorts behind earlier ones.
fs::path new_file(const fs::path& run) {
  const auto now = static_cast<int64_t>(seconds_since_1970());
  for (int number = 0;; ++number) {
    const fs::path path = run / fmt::format("{}{:010}.cloam.{}", kEventFile, now, number);
    if (std::error_code error; !fs::exists(path, error)) return path;
  }
}

using Scalars = std::vector<std::pair<std::string, double>>;

void add(Scalars& scalars, const std::string& tag, const Event& fields, const char* key) {
  if (fields.contains(key) && fields.at(key).is_number()) scalars.emplace_back(tag, fields.at(key).get<double>());
}

Scalars scalars_of_step(const Event& fields) {
  Scalars scalars;
  for (const char* key : {"loss", "learning_rate", "steps_per_second", "memory_bytes"})
    add(scalars, std::string("train/") + key, fields, key);
  for (const auto& [name, value] : fields.at("metrics").items())
    if (value.is_number()) scalars.emplace_back("train/" + name, value.get<double>());
  return scalars;
}

}  // namespace

TensorBoardFile::TensorBoardFile(const fs::path& run, int64_t step) {
  const fs::path path = new_file(run);
  file_.reset(std::fopen(path.c_str(), "wb"));
  if (!file_) throw Error(Fault::write, text(path.string(), ": cannot be written: ", std::strerror(errno)));
  const double now = seconds_since_1970();
  write(event_file_start(now) + (step > 0 ? event_restart({now, step + 1}) : ""));
}

void TensorBoardFile::take(const std::string& name, const Event& fields) {
  if (name != "step" && name != "eval") return;
  const EventMoment when = {seconds_since_1970(), fields.at("step").get<int64_t>()};
  if (name == "step") return write(event_scalars(when, scalars_of_step(fields)));
  Scalars scalars;
  for (const char* key : {"psnr", "ssim"}) add(scalars, std::string("preview/") + key, fields, key);
  const fs::path picture = fields.at("picture").get<std::string>();
  const ImageSize size = read_image_size(picture);
  write(event_scalars(when, scalars) +
        event_picture(when, "preview", read_file(picture, kLargestEventPicture), size.width, size.height));
}

void TensorBoardFile::write(const std::string& records) {
  if (failed_) return;
  const bool written = std::fwrite(records.data(), 1, records.size(), file_.get()) == records.size();
  failed_ = !written || std::fflush(file_.get()) != 0;
  if (failed_) warn("the event file for TensorBoard cannot be written: " + std::string(std::strerror(errno)));
}

}  // namespace cloam
