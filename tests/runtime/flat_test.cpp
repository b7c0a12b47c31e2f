// Tensors side by side in one buffer, and evaluating values where they are wanted.
#include "runtime/flat.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cstdlib>
#include <span>

#include "runtime/device.h"
#include "runtime/error.h"
#include "runtime/ops.h"
#include "runtime/ops/adam.h"

using namespace cloam;

namespace {

std::vector<float> counted(int64_t count, float from) {
  std::vector<float> out;
  for (int64_t i = 0; i < count; i++) out.push_back(from + static_cast<float>(i));
  return out;
}

const std::vector<Shape> kShapes = {{3, 5}, {}, {0, 4}, {1000}, {33}};

float value_at(const Flat& flat, size_t part) { return flat.parts[part].to_host().at(0); }

}  // namespace

TEST_CASE("parts of a flat tensor and the whole are the same memory, with zeros between") {
  const Flat flat = flat_zeros(kShapes);
  float total = 0;
  for (size_t i = 0; i < kShapes.size(); i++) {
    const std::vector<float> values = counted(numel(kShapes[i]), static_cast<float>(10 * i + 1));
    for (float value : values) total += value;
    put_at(from_host(values, kShapes[i]), flat.parts[i]);
    CHECK(flat.parts[i].to_host() == values);
  }
  float found = 0;
  for (float value : flat.all.to_host()) found += value;
  CHECK(found == total);
}

TEST_CASE("a value is evaluated straight into its place, whatever makes it") {
  const Flat flat = flat_zeros({{64, 64}, {64, 64}, {64, 1}, {64, 64}, {64, 64}});
  const Tensor x = from_host(counted(4096, 0), {64, 64});
  const Tensors values = {x * 2.f, matmul(x, x), sum(x, {{1}, true}), transpose(x), zeros({64, 64})};
  const Tensors again = {x * 2.f, matmul(x, x), sum(x, {{1}, true}), transpose(x), zeros({64, 64})};
  for (size_t i = 0; i < values.size(); i++) expect_at(values[i], flat.parts[i]);
  eval(values);
  const int64_t before = device_stats().launches;
  for (size_t i = 0; i < 3; i++) put_at(values[i], flat.parts[i]);
  CHECK(device_stats().launches == before);
  for (size_t i = 3; i < 5; i++) put_at(values[i], flat.parts[i]);  // views share the memory of others: copied
  for (size_t i = 0; i < values.size(); i++) CHECK(flat.parts[i].to_host() == again[i].to_host());
}

TEST_CASE("a tensor that moves keeps its values and its handles") {
  const Flat flat = flat_zeros(kShapes);
  const Tensor p = parameter(counted(15, 1), {3, 5}), other = p;
  move_to(p, flat.parts[0]);
  CHECK(other.to_host() == counted(15, 1));
  put_at(from_host(counted(15, 7), {3, 5}), flat.parts[0]);
  CHECK(other.to_host() == counted(15, 7));
  CHECK_THROWS_AS(move_to(p, flat.parts[3]), Error);
}

TEST_CASE("one Adam step over flat tensors is the step of each, in one launch") {
  const std::vector<Shape> shapes = {{7}, {33, 5}, {4096}};
  const Flat p = flat_zeros(shapes), m = flat_zeros(shapes), v = flat_zeros(shapes), g = flat_zeros(shapes);
  Tensor p_all = p.all, m_all = m.all, v_all = v.all;
  Tensors single_p, single_m, single_v;
  for (const Shape& shape : shapes) {
    single_p.push_back(parameter(counted(numel(shape), -3.f), shape));
    single_m.push_back(zeros(shape));
    single_v.push_back(zeros(shape));
    put_at(single_p.back(), p.parts[single_p.size() - 1]);
  }
  for (int step = 1; step <= 3; step++) {
    for (size_t i = 0; i < shapes.size(); i++) {
      const Tensor gradient = from_host(counted(numel(shapes[i]), static_cast<float>(step) - 20.f), shapes[i]);
      adam_step(single_p[i], single_m[i], single_v[i], gradient, {.step = step});
      put_at(gradient, g.parts[i]);
    }
    const int64_t before = device_stats().launches;
    adam_step(p_all, m_all, v_all, g.all, {.step = step});
    CHECK(device_stats().launches == before + 1);
  }
  for (size_t i = 0; i < shapes.size(); i++) CHECK(p.parts[i].to_host() == single_p[i].to_host());
  CHECK(value_at(p, 0) != -3.f);
}

TEST_CASE("the host reads and overwrites rows, and nothing beside them") {
  const Tensor x = made_to_stay(from_host(counted(15, 1), {5, 3}));
  std::vector<float> seen;
  read_on_host(transpose(x), [&](std::span<const float> values) { seen.assign(values.begin(), values.end()); });
  CHECK(seen == transpose(x).to_host());
  const auto floats = [](auto bytes) { return bytes.size() / size_of(DType::f32); };
  read_rows_on_host(x, 1, 3, [&](std::span<const std::byte> from) {
    CHECK(floats(from) == 6);
    overwrite_rows_on_host(x, 3, 5, [&](std::span<std::byte> to) { std::ranges::copy(from, to.begin()); });
  });
  overwrite_rows_on_host(x, 5, 5, [&](std::span<std::byte> none) { CHECK(none.empty()); });
  CHECK(x.to_host() == std::vector<float>{1, 2, 3, 4, 5, 6, 7, 8, 9, 4, 5, 6, 7, 8, 9});
  CHECK_THROWS_AS(read_rows_on_host(x, 4, 6, [](auto) {}), Error);
  CHECK_THROWS_AS(read_rows_on_host(transpose(x), 0, 1, [](auto) {}), Error);
  CHECK_THROWS_AS(overwrite_rows_on_host(x, 0, 5, [](auto) { throw Error(Fault::data, "given up"); }), Error);
  CHECK((x + 1.f).to_host().size() == 15);  // what was given up is the device's again
}

TEST_CASE("flat tensors in memory of the host: the device works in it where it says so") {
  if (device().platform.find("Portable Computing Language") != std::string::npos) CHECK(computes_in_host_memory());
  if (!computes_in_host_memory()) return;
  constexpr size_t kPage = 4096;
  const auto count = static_cast<size_t>(flat_size(kShapes));
  const std::shared_ptr<std::byte> memory(static_cast<std::byte*>(std::aligned_alloc(kPage, 16 * kPage)), std::free);
  REQUIRE(count * sizeof(float) <= 16 * kPage);
  const std::span values(reinterpret_cast<float*>(memory.get()), count);
  std::ranges::fill(values, 2.f);
  {
    const Flat flat = flat_in(memory, kShapes);
    CHECK(memory.use_count() == 2);
    CHECK(flat.parts[3].to_host() == std::vector<float>(1000, 2.f));
    put_at(from_host(counted(33, 5), {33}), flat.parts[4]);
    synchronize();
    const std::vector<float> seen(&values[static_cast<size_t>(flat.begins[4])],
                                  &values[static_cast<size_t>(flat.begins[4])] + 33);
    CHECK(seen == counted(33, 5));
    CHECK(values[static_cast<size_t>(flat.begins[4]) - 1] == 2.f);
  }
  CHECK(memory.use_count() == 1);
}
