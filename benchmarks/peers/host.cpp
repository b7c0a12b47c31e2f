// Plain C++ on all cores as a peer, where no library does the work: std::sort, and a scalar loop over splats.
#include <cmath>
#include <cstdint>
#include <memory>
#include <random>
#include <thread>

#include "benchmarks/peers/peer.h"
#include "benchmarks/splat_input.h"

namespace {

template <class Key>
struct Pair {
  Key key;
  uint32_t payload;
  bool operator<(const Pair& other) const { return key < other.key; }
};

/// Two sorted halves [0, middle) and [middle, n) into `out`, by two threads that part at a key.
template <class P>
void merge_halves(const std::vector<P>& in, std::vector<P>& out) {
  const auto middle = in.begin() + static_cast<int64_t>(in.size() / 2), a = in.begin() + (middle - in.begin()) / 2,
             b = std::lower_bound(middle, in.end(), *a);
  std::thread upper([&] { std::merge(a, middle, b, in.end(), out.begin() + (a - in.begin()) + (b - middle)); });
  std::merge(in.begin(), a, middle, b, out.begin());
  upper.join();
}

/// std::sort of random pairs of key and payload, half by each of two threads, then merged.
template <class Key>
peer::Run prepare_sort(size_t n) {
  auto given = std::make_shared<std::vector<Pair<Key>>>(n);
  std::mt19937_64 random(0);
  for (size_t i = 0; i < n; i++) (*given)[i] = {static_cast<Key>(random()), static_cast<uint32_t>(i)};
  auto halves = std::make_shared<std::vector<Pair<Key>>>(n), sorted = std::make_shared<std::vector<Pair<Key>>>(n);
  return [=] {
    const auto sort_half = [&](int which) {
      const auto from = static_cast<int64_t>(n / 2) * which,
                 to = which ? static_cast<int64_t>(n) : static_cast<int64_t>(n / 2);
      std::copy(given->begin() + from, given->begin() + to, halves->begin() + from);
      std::sort(halves->begin() + from, halves->begin() + to);
    };
    std::thread upper(sort_half, 1);
    sort_half(0);
    upper.join();
    merge_halves(*halves, *sorted);
  };
}

struct Picture {
  cloam::SplatInput in;
  std::vector<float> out;  // [H,W,4]: colour, transmittance
};

/// One pixel of kernels/splat.cl's formulas.
void blend_pixel(Picture& picture, int x, int y) {
  const cloam::SplatInput& in = picture.in;
  const int tile = y / 16 * ((in.width + 15) / 16) + x / 16;
  float colour[3] = {0, 0, 0}, through = 1;
  for (int k = in.offsets[tile]; k < in.offsets[tile + 1]; k++) {
    const int i = in.ids[k];
    const float dx = in.means[2 * i] - (x + 0.5f), dy = in.means[2 * i + 1] - (y + 0.5f);
    const float power =
        -0.5f * (in.conics[3 * i] * dx * dx + in.conics[3 * i + 2] * dy * dy) - in.conics[3 * i + 1] * dx * dy;
    if (power > 0) continue;
    const float alpha = std::min(0.99f, in.opacities[i] * std::exp(power));
    if (alpha < 1 / 255.f) continue;
    const float next = through * (1 - alpha);
    if (next < 1e-4f) break;
    for (int c = 0; c < 3; c++) colour[c] += through * alpha * in.colours[3 * i + c];
    through = next;
  }
  float* to = &picture.out[4 * (static_cast<size_t>(y) * in.width + x)];
  for (int c = 0; c < 3; c++) to[c] = colour[c];
  to[3] = through;
}

void blend_tile(Picture& picture, int tile) {
  const int across = (picture.in.width + 15) / 16, left = tile % across * 16, top = tile / across * 16;
  for (int y = top; y < std::min(top + 16, picture.in.height); y++)
    for (int x = left; x < std::min(left + 16, picture.in.width); x++) blend_pixel(picture, x, y);
}

peer::Run prepare_splats(int width, int height) {
  auto picture = std::make_shared<Picture>();
  picture->in = cloam::splat_input(width, height);
  picture->out.resize(4 * static_cast<size_t>(width) * height);
  return [picture] {
    const int tiles = static_cast<int>(picture->in.offsets.size()) - 1;
#pragma omp parallel for schedule(dynamic)
    for (int tile = 0; tile < tiles; tile++) blend_tile(*picture, tile);
  };
}

}  // namespace

int main() {
  constexpr size_t kFourMillion = size_t{1} << 22;
  return peer::serve("C++ of " __VERSION__,
                     {{"sort.4m.u64", [] { return prepare_sort<uint64_t>(kFourMillion); }},
                      {"sort.4m.u32", [] { return prepare_sort<uint32_t>(kFourMillion); }},
                      {"splat_blend.80x64.3k.fwd", [] { return prepare_splats(80, 64); }},
                      {"splat_blend.256x192.38k.fwd", [] { return prepare_splats(256, 192); }},
                      {"splat_blend.800x608.400k.fwd", [] { return prepare_splats(800, 608); }},
                      {"splat_blend.2528x1920.4m.fwd", [] { return prepare_splats(2528, 1920); }}});
}
