// See actor_masks.h.
#include "models/data/actor_masks.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>

#include "models/io/image.h"
#include "models/io/in_parallel.h"
#include "models/io/json.h"
#include "models/io/paths.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

/// "camera/front_camera/07.jpg" -> "truth/front_camera/07_actor.png"; images of the truth itself have theirs beside.
std::string mask_path(const Frame& frame) {
  fs::path path = frame.image;
  if (frame.image.starts_with("camera/")) path = "truth" / path.lexically_relative("camera");
  return (path.parent_path() / (path.stem().string() + "_actor.png")).generic_string();
}

/// Where the line from `origin` along `direction` (in box axes) enters the box of this size about 0, in lengths of
/// direction; none if it misses it or the box lies behind. Kay and Kajiya 1986: three slabs.
std::optional<double> entry(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
                            const Eigen::Vector3d& size) {
  double near = 0, far = std::numeric_limits<double>::infinity();
  for (int axis = 0; axis < 3; ++axis) {
    const double half = 0.5 * size[axis];
    if (direction[axis] == 0) {
      if (std::abs(origin[axis]) > half) return std::nullopt;
      continue;
    }
    const double a = (-half - origin[axis]) / direction[axis], b = (half - origin[axis]) / direction[axis];
    near = std::max(near, std::min(a, b));
    far = std::min(far, std::max(a, b));
  }
  return near <= far ? std::optional(near) : std::nullopt;
}

/// The number that more than half of the pixels of a block are, all actors together being more than half of it: else 0.
int most_of(std::vector<int>& block) {
  const auto empty = static_cast<std::size_t>(std::count(block.begin(), block.end(), 0));
  if (2 * empty >= block.size()) return 0;
  std::map<int, int> counts;
  for (const int actor : block)
    if (actor != 0) ++counts[actor];
  return std::max_element(counts.begin(), counts.end(),
                          [](const auto& a, const auto& b) { return a.second < b.second; })
      ->first;
}

ActorMask reduced(const ActorMask& full, int factor) {
  if (factor == 1) return full;
  ActorMask mask{full.width / factor, full.height / factor, {}};
  std::vector<int> block;
  for (int row = 0; row < mask.height; ++row) {
    for (int column = 0; column < mask.width; ++column) {
      block.clear();
      for (int i = 0; i < factor * factor; ++i) {
        const int y = row * factor + i / factor, x = column * factor + i % factor;
        block.push_back(full.actors[static_cast<std::size_t>(y) * full.width + x]);
      }
      mask.actors.push_back(most_of(block));
    }
  }
  return mask;
}

}  // namespace

std::vector<std::uint8_t> ActorMask::any() const {
  std::vector<std::uint8_t> mask(actors.size());
  std::transform(actors.begin(), actors.end(), mask.begin(), [](int actor) { return actor != 0 ? 255 : 0; });
  return mask;
}

std::vector<std::uint8_t> ActorMask::moving(const Scene& scene) const {
  std::vector<std::uint8_t> counts = {0};  // by number
  for (const Actor& actor : scene.actors) counts.push_back(goes_somewhere(actor) ? 255 : 0);
  std::vector<std::uint8_t> mask(actors.size());
  std::transform(actors.begin(), actors.end(), mask.begin(),
                 [&](int actor) { return counts.at(static_cast<std::size_t>(actor)); });
  return mask;
}

ActorMasks::ActorMasks(const Scene& scene, bool use_truth) : scene_(scene) {
  const fs::path path = scene.root / "truth" / "actors.json";
  if (use_truth && has_file(path)) read_numbers(path);
}

ActorMasks ActorMasks::from(const Scene& scene, const fs::path& folder) {
  ActorMasks masks(scene, false);
  masks.folder_ = folder;
  const fs::path path = folder / "actors.json";
  if (!has_file(path)) bad_data("no ", path.string(), ": want {\"NUMBER IN THE MASKS\": \"ID OF THE ACTOR\", ...}");
  masks.read_numbers(path);
  return masks;
}

void ActorMasks::read_numbers(const fs::path& path) {
  use_truth_ = true;
  std::map<std::string, int> places;
  for (std::size_t i = 0; i < scene_.actors.size(); ++i) places[scene_.actors[i].id] = 1 + static_cast<int>(i);
  const Json json = parse_json_file(path);
  if (!json.is_object()) bad_data(path.string() + ": want an object of instance numbers");
  for (const auto& [number, id] : json.items()) {
    const bool sound = !number.empty() && number.size() <= 5 &&
                       std::all_of(number.begin(), number.end(), [](char c) { return c >= '0' && c <= '9'; });
    if (!sound || !id.is_string()) bad_data(path.string(), ": \"", number.substr(0, 40), "\": want \"NUMBER\": \"ID\"");
    const auto place = places.find(id.get<std::string>());
    numbers_[std::stoi(number)] = place == places.end() ? 0 : place->second;  // without any box: does not count
  }
}

fs::path ActorMasks::mask_file(const Frame& frame) const {
  if (folder_.empty()) return scene_.root / mask_path(frame);
  const std::string name = fs::path(frame.image).stem().string() + "_actor.png";
  return folder_ / path_named(folder_, frame.sensor + "/" + name, false);
}

bool ActorMasks::has_truth(const Frame& frame) const { return use_truth_ && has_file(mask_file(frame)); }

ActorMask ActorMasks::read(const Frame& frame, const Camera& camera) const {
  const fs::path path = mask_file(frame);
  const Labels labels = read_labels(path);
  const int factor = camera.width > 0 ? std::max(1, labels.width / camera.width) : 1;
  if (labels.width / factor != camera.width || labels.height / factor != camera.height)
    bad_data(path.string(), ": the mask has ", labels.width, "x", labels.height, " pixels, the image as loaded ",
             camera.width, "x", camera.height);
  std::vector<int> actors(1 << 16, 0);  // by number; 0: has no box at this step
  for (const auto& [number, actor] : numbers_)
    if (number < std::ssize(actors) && actor > 0 &&
        box_at_step(scene_.actors[static_cast<std::size_t>(actor) - 1], frame.step))
      actors[static_cast<std::size_t>(number)] = actor;
  ActorMask mask{labels.width, labels.height, std::vector<int>(labels.values.size())};
  std::transform(labels.values.begin(), labels.values.end(), mask.actors.begin(),
                 [&](std::uint16_t number) { return actors[number]; });
  return reduced(mask, factor);
}

ActorMask ActorMasks::of(const Frame& frame, const Camera& camera) const {
  if (has_truth(frame)) return read(frame, camera);
  std::vector<PlacedBox> boxes;
  for (std::size_t i = 0; i < scene_.actors.size(); ++i) {
    const Actor& actor = scene_.actors[i];
    if (const auto pose = world_from_box_of_step(actor, frame.step, frame.timestamp))
      boxes.push_back({1 + static_cast<int>(i), actor.size, *pose});
  }
  return outlines(boxes, camera, frame.world_from_camera);
}

std::vector<std::vector<float>> actor_shares(const Scene& scene, const Pixels& photos, int cell) {
  const ActorMasks masks(scene);
  std::vector<std::vector<float>> shares(photos.frames.size());
  in_parallel(shares.size(), [&](std::size_t i) {
    const FramePixels& photo = photos.frames[i];
    std::vector<float>& cells = shares[i];
    const Frame& frame = scene.frames[photo.frame];
    if (!masks.has_truth(frame)) return;
    const ActorMask mask = masks.of(frame, photos.cameras[static_cast<std::size_t>(photo.camera)]);
    const int rows = mask.height / cell, columns = mask.width / cell;
    cells.assign(static_cast<std::size_t>(rows * columns), 0.f);
    for (int y = 0; y < rows * cell; ++y)
      for (int x = 0; x < columns * cell; ++x)
        if (mask.actors[static_cast<std::size_t>(y * mask.width + x)] != 0)
          cells[static_cast<std::size_t>(y / cell * columns + x / cell)] += 1.f / static_cast<float>(cell * cell);
  });
  return shares;
}

ActorMask outlines(const std::vector<PlacedBox>& boxes, const Camera& camera,
                   const Eigen::Matrix4d& world_from_camera) {
  const std::size_t count = static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
  const std::vector<float> directions = pixel_directions(camera);
  ActorMask mask{camera.width, camera.height, std::vector<int>(count, 0)};
  std::vector<double> nearest(count, std::numeric_limits<double>::infinity());
  for (const PlacedBox& box : boxes) {
    const Eigen::Matrix4d box_from_camera = box.world_from_box.inverse() * world_from_camera;
    const Eigen::Matrix3d turn = box_from_camera.topLeftCorner<3, 3>();
    const Eigen::Vector3d origin = box_from_camera.topRightCorner<3, 1>();
    for (std::size_t i = 0; i < count; ++i) {
      const Eigen::Vector3d ray(directions[3 * i], directions[3 * i + 1], directions[3 * i + 2]);
      const auto at = entry(origin, turn * ray, box.size);
      if (!at || *at >= nearest[i]) continue;
      nearest[i] = *at;
      mask.actors[i] = box.actor;
    }
  }
  return mask;
}

}  // namespace cloam
