// Assets of GenAssets' streets: added ones, worn ones, and what actors have besides their codes.
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "models/methods/genassets.h"
#include "models/scene/edit.h"
#include "models/scene/orbit.h"
#include "runtime/error.h"
#include "tests/models/folder.h"
#include "tests/models/toy_genassets.h"

using namespace cloam;
using Eigen::Vector3d;

namespace {

/// Whether a ray meets the actor, or the ground on which its shadow may fall: under the room of its box, twice as
/// large.
bool reaches(const Actor& actor, const Vector3d& origin, const Vector3d& way) {
  const auto [from, to] = within(actor, origin, way);
  if (to > from) return true;
  const Eigen::Matrix4d box_from_world = actor.boxes[0].world_from_box.inverse();
  const Vector3d o = (box_from_world * origin.homogeneous()).head<3>(), d = box_from_world.topLeftCorner<3, 3>() * way,
                 half = actor.size / 2 + Vector3d(0.125, 0.125, 0.05);
  if (d.z() >= 0) return false;
  const Vector3d hit = o + (-half.z() - o.z()) / d.z() * d;
  return std::abs(hit.x()) <= 2 * half.x() && std::abs(hit.y()) <= 2 * half.y();
}

/// Pixels that the actors cannot reach, themselves, by their shadows or through the image decoder: cells of 2x2 pixels
/// further than 6 from those whose rays do (convolutions 3x3: one, two blocks of two, and one on pixels).
std::vector<bool> out_of_reach(const Camera& camera, const std::vector<Actor>& actors) {
  const int columns = camera.width / 2, rows = camera.height / 2, far = 6;
  const Eigen::Matrix4d pose = toy_camera_pose(0);
  std::vector<bool> out(static_cast<size_t>(camera.width * camera.height), true);
  for (int row = 0; row < rows; ++row)
    for (int column = 0; column < columns; ++column) {
      const Vector3d way = pose.topLeftCorner<3, 3>() * direction(camera, {2 * column + 1., 2 * row + 1.}).normalized();
      const auto is_reached = [&](const Actor& a) { return reaches(a, pose.topRightCorner<3, 1>(), way); };
      if (std::none_of(actors.begin(), actors.end(), is_reached)) continue;
      for (int y = 2 * std::max(0, row - far); y < 2 * std::min(rows, row + far + 1); ++y)
        for (int x = 2 * std::max(0, column - far); x < 2 * std::min(columns, column + far + 1); ++x)
          out[static_cast<size_t>(y * camera.width + x)] = false;
    }
  return out;
}

}  // namespace

TEST_CASE("genassets: texels beside an actor's code show on it alone, learn with frozen networks, of one image not") {
  const Folder folder;
  const Scene scene = crossing(folder.path, 5);
  const Settings frozen = {{"networks.frozen", "true"}};
  CHECK_FALSE(built(scene)->parameters().contains("log0.detail"));
  CHECK_FALSE(
      built(scene, {{"networks.frozen", "true"}, {"beyond.detail", "false"}})->parameters().contains("log0.detail"));
  const auto method = built(scene, frozen);
  fill(*method);
  const Camera camera = turntable_camera(16, 16);
  const Eigen::Matrix4d pose = turntable_poses({2, 3, 6}, camera, 8)[1];
  const auto look = [&](const AssetName& asset) { return as<Street>(*method)->render_asset(asset, camera, pose).rgb; };
  const std::vector<float> rows = method->parameters().at("log0.codes").to_host();
  const auto numbers = static_cast<std::ptrdiff_t>(rows.size() / 4);
  const NewAsset same{0, false, {2, 3, 6}, {rows.begin(), rows.begin() + numbers}};
  const AssetName front{0, "front"}, hidden{0, "hidden"}, made = as<ShowsAssets>(*method)->show_assets({same}).front();
  const auto first = look(front), second = look(hidden), generated = look(made);
  CHECK(generated == first);
  std::vector<float> detail = method->parameters().at("log0.detail").to_host();
  CHECK(*std::max_element(detail.begin(), detail.end()) == 0);
  CHECK(detail.size() == 2 * 3 * 8 * 8 * 4);
  std::fill(detail.begin(), detail.begin() + static_cast<std::ptrdiff_t>(detail.size() / 2), 0.5f);
  put(*method, "log0.detail", detail);
  CHECK(look(front) != first);
  CHECK(look(hidden) == second);
  CHECK(look(made) == generated);

  // In a street where the hidden actor wears a generated asset: its own texels show nowhere.
  Scene worn = scene;
  worn.actors[1].asset = made;
  const auto street = loaded(worn, frozen);
  fill(*street);
  CHECK(as<ShowsAssets>(*street)->show_assets({same}).front() == made);
  const auto picture = [&](size_t row) {
    std::vector<float> texels(detail.size(), 0.f);
    const auto begin = texels.begin() + static_cast<std::ptrdiff_t>(row * texels.size() / 2);
    if (row < 2) std::fill(begin, begin + static_cast<std::ptrdiff_t>(texels.size() / 2), 0.5f);
    put(*street, "log0.detail", texels);
    return shown(*street, view_of(worn.frames[0], worn.cameras[0], 0));
  };
  const Picture none = picture(2);
  CHECK(std::count(none.actors.begin(), none.actors.end(), 1) > 10);
  CHECK(std::count(none.actors.begin(), none.actors.end(), 2) > 10);
  CHECK(picture(1).rgb == none.rgb);
  CHECK(picture(0).rgb != none.rgb);

  for (const bool one : {false, true}) {
    const auto learner = loaded(scene, frozen, one ? std::optional<size_t>(0) : std::nullopt);
    fill(*learner, -0.4f);
    (void)train_to(*learner, folder.path / (one ? "one" : "two"));
    const std::vector<float> learned = learner->parameters().at("log0.detail").to_host();
    CHECK((learned == std::vector<float>(learned.size(), 0.f)) == one);
  }
}

TEST_CASE(
    "genassets: an asset that is added with an actor's code, class and size looks like it, one of another code not") {
  const Folder folder;
  const auto method = built(crossing(folder.path, 5));
  fill(*method);
  Street& street = *as<Street>(*method);
  HasSurfaces& shapes = *as<HasSurfaces>(*method);
  ShowsAssets& assets = *as<ShowsAssets>(*method);
  const std::vector<float> rows = method->parameters().at("log0.codes").to_host();
  const size_t numbers = rows.size() / 4;  // two actors, mean and log variance
  NewAsset same{0, false, {2, 3, 6}, {rows.begin(), rows.begin() + static_cast<std::ptrdiff_t>(numbers)}};
  NewAsset other = same;
  for (float& value : other.code) value = 1 - 40 * value;
  const AssetName own{0, "front"}, added{1, "generated"}, another{2, "generated"};
  CHECK(assets.show_assets({same, other}) == std::vector<AssetName>{added, another});
  const Camera camera = turntable_camera(16, 16);
  const Eigen::Matrix4d pose = turntable_poses(same.size, camera, 8)[1];
  const std::vector<float> picture = street.render_asset(own, camera, pose).rgb;
  CHECK(*std::min_element(picture.begin(), picture.end()) < 0.9f);  // it is seen
  CHECK(street.render_asset(added, camera, pose).rgb == picture);
  CHECK(street.render_asset(another, camera, pose).rgb != picture);
  const std::vector<float> points = {0, 0, 0, 0.5f, 1, -1};
  CHECK(shapes.sample_asset(added, points).distances == shapes.sample_asset(own, points).distances);
  same.code.pop_back();
  CHECK_THROWS_WITH_AS(assets.show_assets({same}), doctest::Contains("63 numbers, the run's codes have 64"), Error);
  const auto planes = built(crossing(folder.path, 5), {{"decoder.use", "false"}});
  CHECK_THROWS_WITH_AS(as<ShowsAssets>(*planes)->show_assets({other}), doctest::Contains("decoder.use"), Error);
}

TEST_CASE("genassets: an actor that wears an added asset changes no pixel that it does not reach, to the bit") {
  const Folder folder;
  const Camera camera{200, 150, 200, 200, 100, 75};
  Scene before = toy_street(folder.path);
  before.actors = {toy_actor("swapped", {2, 3, 1.5}, 12, 3), toy_actor("stays", {2, 3, 2}, 12, -4)};
  const auto old = loaded(before);
  fill(*old);
  const Picture was = shown(*old, {camera, toy_camera_pose(0), 0, 0.3});
  for (const Vector3d& size : {Vector3d(2, 3, 1.5), Vector3d(2.3, 2.5, 2)}) {
    Scenes after = {before};
    apply(Replace{added_asset(1, 0), size}, after, {0, "swapped"});
    const auto method = loaded(after[0]);
    fill(*method);
    std::vector<float> code(64);
    for (size_t i = 0; i < code.size(); ++i) code[i] = 3 * std::sin(static_cast<float>(i));
    CHECK(as<ShowsAssets>(*method)->show_assets({{0, false, size, code}}).front() == added_asset(1, 0));
    const Picture is = shown(*method, {camera, toy_camera_pose(0), 0, 0.3});
    const std::vector<bool> far = out_of_reach(camera, {before.actors[0], after[0].actors[0]});
    int outside = 0, stays = 0, changed = 0;
    float most = 0;
    for (size_t at = 0; at < far.size(); ++at) {
      float apart = 0;
      for (size_t k = 0; k < 3; ++k) apart = std::max(apart, std::abs(is.rgb[3 * at + k] - was.rgb[3 * at + k]));
      if (!far[at]) changed += apart > 0;
      if (!far[at]) continue;
      most = std::max({most, apart, std::abs(is.depth[at] - was.depth[at])});
      CHECK(is.actors[at] == was.actors[at]);
      outside++;
      stays += is.actors[at] == 2;
    }
    CHECK(most == 0);
    CHECK(outside > 10000);
    CHECK(stays > 500);  // the other actor's pixels among them
    CHECK(changed > 500);
  }
}
