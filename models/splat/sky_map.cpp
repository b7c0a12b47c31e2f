// See sky_map.h.
#include "models/splat/sky_map.h"

#include "runtime/ops/sample.h"

namespace cloam {

Tensor sky_colours(const Tensor& faces, const Tensor& directions) {
  const auto along = [&](int axis) { return reshape(slice(directions, 1, axis, axis + 1), {directions.dim(0)}); };
  const Tensor x = along(0), y = along(1), z = along(2);
  const Tensor longest = maximum(maximum(abs(x), abs(y)), abs(z));
  const Tensor on_x = equal(abs(x), longest), on_y = equal(abs(y), longest);
  const auto chosen = [&](const Tensor& a, const Tensor& b, const Tensor& c) {
    return where(on_x, a, where(on_y, b, c));
  };
  const auto face = [](const Tensor& way, float first) { return where(way < 0.f, first + 1.f, Tensor(first)); };
  const Tensor owners = cast(chosen(face(x, 0), face(y, 2), face(z, 4)), DType::i32);
  const auto place = [&](const Tensor& way) { return unsqueeze(way / longest * 0.5f + 0.5f, 1); };
  // Four channels are a vector: their gradient on CPU devices needs no sort.
  const Tensor vectors = pad(faces, 3, 0, 1);
  return slice(sample_images(vectors, concat({place(chosen(y, x, x)), place(chosen(z, z, y))}, 1), owners), 1, 0, 3);
}

Tensor directions_of(const Camera& camera) {
  return from_host(pixel_directions(camera), {int64_t{camera.height} * camera.width, 3});
}

Tensor turned_directions(const Tensor& directions, const Eigen::Matrix4d& world_from_camera) {
  std::vector<float> turned;
  for (int from = 0; from < 3; ++from)
    for (int to = 0; to < 3; ++to) turned.push_back(static_cast<float>(world_from_camera(to, from)));
  return matmul(directions, from_host(turned, {3, 3}));
}

}  // namespace cloam
