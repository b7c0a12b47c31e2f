// See box_file.h. Poses are the upper three rows of their matrices, with all digits.
#include "models/runs/box_file.h"

#include <cmath>
#include <string_view>

#include "models/io/paths.h"
#include "models/io/sha256.h"
#include "models/io/tensors.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kBoxesName = "boxes-", kBoxesEnding = ".safetensors";
constexpr std::size_t kDigestLength = 16, kPoseNumbers = 12;
using PoseRows = Eigen::Matrix<double, 3, 4, Eigen::RowMajor>;

struct BoxArrays {
  std::vector<int64_t> steps;
  std::vector<double> times, poses;

  void add(const ActorBox& box) {
    steps.push_back(box.step);
    times.push_back(box.timestamp);
    const PoseRows rows = box.world_from_box.topRows<3>();
    poses.insert(poses.end(), rows.data(), rows.data() + kPoseNumbers);
  }
};

TensorMap tensors_of(const BoxArrays& boxes) {
  const auto count = static_cast<int64_t>(boxes.steps.size());
  return {{"step", named_integers(boxes.steps)},
          {"timestamp", named_doubles(boxes.times, {count})},
          {"world_from_box", named_doubles(boxes.poses, {count, 3, 4})}};
}

std::string digest_of(const TensorMap& tensors) {
  Sha256 sum;
  for (const auto& [name, tensor] : tensors)
    sum.add({reinterpret_cast<const std::uint8_t*>(tensor.data.data()), tensor.data.size()});
  return sum.digits().substr(0, kDigestLength);
}

bool is_box_file(const std::string& name) {
  return name.starts_with(kBoxesName) && name.ends_with(kBoxesEnding) && name.find('/') == std::string::npos;
}

std::vector<ActorBox> boxes_from(const TensorMap& tensors) {
  const auto found = tensors.find("step");
  const int64_t count = found == tensors.end() || found->second.shape.empty() ? 0 : found->second.shape[0];
  const auto steps = values_from<int64_t>(tensors, "step", {count});
  const auto times = values_from<double>(tensors, "timestamp", {count});
  const auto poses = values_from<double>(tensors, "world_from_box", {count, 3, 4});
  std::vector<ActorBox> boxes(steps.size());
  for (std::size_t i = 0; i < boxes.size(); ++i) {
    ActorBox& box = boxes[i];
    if (steps[i] < 0 || steps[i] > kMaxSteps) bad_data("box ", i, ": the step is ", steps[i]);
    box.step = static_cast<int>(steps[i]);
    box.timestamp = times[i];
    box.world_from_box.topRows<3>() = Eigen::Map<const PoseRows>(&poses[kPoseNumbers * i]);
    if (!std::isfinite(box.timestamp) || !box.world_from_box.allFinite())
      bad_data("box ", i, ": a number is not finite");
  }
  return boxes;
}

}  // namespace

std::string write_boxes(const fs::path& folder, const Scenes& scenes) {
  BoxArrays boxes;
  for (const Scene& scene : scenes)
    for (const Actor& actor : scene.actors)
      for (const ActorBox& box : actor.boxes) boxes.add(box);
  if (boxes.steps.empty()) return "";
  SafetensorsFile file{tensors_of(boxes), {}};
  boxes = {};
  const std::string name = text(kBoxesName, digest_of(file.tensors), kBoxesEnding);
  write_safetensors(folder / name, file);
  return name;
}

std::vector<ActorBox> read_boxes(const fs::path& folder, const std::string& name) {
  const fs::path path = folder / name;
  if (!is_box_file(name)) bad_data((folder / "scene.json").string(), ": \"box_file\" is no name of a box file");
  if (!is_file(path))
    bad_data(path.string(), " is missing: it holds the boxes of scene.json",
             "\n  fix: copy it from where the run came from, or train again");
  try {
    return boxes_from(read_safetensors(path).tensors);
  } catch (const Error& error) {
    const std::string what = error.what(), head = what.starts_with(path.string()) ? "" : path.string() + ": ";
    bad_data(head, what, "\n  fix: copy it from where the run came from, or train again");
  }
}

std::vector<fs::path> box_files(const fs::path& folder) {
  std::vector<fs::path> found;
  for (const fs::path& entry : entries_of(folder))
    if (is_box_file(entry.filename().string())) found.push_back(entry);
  return found;
}

}  // namespace cloam
