// Outlines of actors in pictures whose rays stand for several pixels.
#include "models/street/street_views.h"

#include <doctest/doctest.h>

#include "runtime/ops.h"
#include "tests/models/toy_street.h"

using namespace cloam;

namespace {

struct Cell {
  float opacity;
  int32_t owner;  // -1: none
};

/// The actors of a picture 34 pixels wide and 3 high, made by rays of 2 x 2 pixels: all rows show the same.
std::vector<int> actors_of_row(const std::vector<Cell>& cells) {
  const Folder folder;
  const Scene scene = toy_street(folder.path, {.width = 34, .height = 3});
  const StreetSpace space(scene, {});
  StreetPainter painter;
  painter.scale = 2;
  painter.look = [&](const RayList& rays) {
    REQUIRE(rays.count() == 2 * static_cast<int64_t>(cells.size()));
    std::vector<float> opacity;
    SeenByRays seen;
    for (int row = 0; row < 2; ++row)
      for (const Cell& cell : cells) {
        opacity.push_back(cell.opacity);
        seen.owners.push_back(cell.owner);
      }
    const int64_t count = rays.count();
    seen.actor_opacity = seen.opacity = from_host(opacity, {count});
    seen.depth = ones({count});
    seen.features = zeros({count, 3});
    return seen;
  };
  painter.image = [](const Tensor& features, const Tensor&) { return resize_bilinear(features, 4, 34); };
  const Picture picture = street_picture(painter, view_of(scene.frames[0], scene.cameras[0], 0), space);
  REQUIRE(picture.actors.size() == 34 * 3);
  const std::vector<int> row(picture.actors.begin(), picture.actors.begin() + 34);
  for (std::size_t i = 0; i < picture.actors.size(); ++i) CHECK(picture.actors[i] == row[i % 34]);
  return row;
}

}  // namespace

// Pixel x has its middle at (x + 0.5) / 2 - 0.5 in cells. Opacity falls from 1 at cell 7 to 0.6 at cell 8 and to 0 at
// cell 9: to a half at 8 + 1/6, between the middles of the pixels 16 (7.75) and 17 (8.25).
TEST_CASE("outlines lie between rays where opacity, as it changes from one to the next, is a half") {
  std::vector<Cell> cells(17, {0, -1});
  for (std::size_t i = 0; i < 8; ++i) cells[i] = {1, 4};
  cells[8] = {0.6f, 4};
  const std::vector<int> row = actors_of_row(cells);
  for (int x = 0; x < 34; ++x) CHECK(row[static_cast<std::size_t>(x)] == (x <= 16 ? 5 : 0));
}

TEST_CASE("a pixel between two actors shows the one that most of it is of, up to the picture's edge") {
  std::vector<Cell> cells(17, {1, 2});
  for (std::size_t i = 0; i < 5; ++i) cells[i] = {1, 0};
  cells[4].opacity = 0.4f;  // at pixel 9 (4.25) the first has 0.75 * 0.4, the second 0.25; at pixel 10 0.1 and 0.75
  const std::vector<int> row = actors_of_row(cells);
  for (int x = 0; x < 34; ++x) CHECK(row[static_cast<std::size_t>(x)] == (x < 10 ? 1 : 3));
  cells[5].opacity = 0.1f;  // at pixel 9 no more than 0.325 is anyone's
  CHECK(actors_of_row(cells)[9] == 0);
}
