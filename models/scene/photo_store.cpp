// See photo_store.h.
#include "models/scene/photo_store.h"

#include <algorithm>

#include "models/io/in_parallel.h"

namespace cloam {
namespace {

Pixels outlines_of(const Pixels& pixels) {
  Pixels listed{pixels.cameras, {}, pixels.has_alpha, pixels.warnings};
  for (const FramePixels& photo : pixels.frames)
    listed.frames.push_back({photo.frame, photo.camera, photo.width, photo.height, {}, {}});
  return listed;
}

uint64_t bytes_of(const FramePixels& outline, const PhotoPlanes& planes) {
  const uint64_t pixel = 4 + (planes.masks ? 1 : 0) + (planes.depths ? sizeof(float) : 0);
  return pixel * static_cast<uint64_t>(outline.width) * static_cast<uint64_t>(outline.height);
}

PhotoPlanes planes_of(const Pixels& pixels) {
  PhotoPlanes planes;
  for (const FramePixels& photo : pixels.frames) {
    planes.masks |= !photo.mask.empty();
    planes.depths |= !photo.depth.empty();
  }
  return planes;
}

}  // namespace

PhotoStore::PhotoStore(Pixels pixels)
    : listed_(std::make_shared<const Pixels>(outlines_of(pixels))),
      planes_(planes_of(pixels)),
      photos_(std::move(pixels.frames)) {}

PhotoStore::PhotoStore(Pixels listed, const PhotoPlanes& planes,
                       const std::function<FramePixels(const FramePixels& outline)>& load,
                       std::shared_ptr<HostStore> store)
    : listed_(std::make_shared<const Pixels>(std::move(listed))),
      planes_(planes),
      photos_(
          std::move(store), listed_->frames.size(),
          [load, all = listed_](std::size_t place) { return load(all->frames[place]); },
          [planes, all = listed_](std::size_t place) { return bytes_of(all->frames[place], planes); }) {}

uint64_t PhotoStore::bytes() const {
  uint64_t sum = 0;
  for (const FramePixels& photo : listed_->frames) sum += bytes_of(photo, planes_);
  return sum;
}

Pixels PhotoStore::all() const {
  Pixels pixels = *listed_;
  in_parallel(size(), [&](std::size_t place) { pixels.frames[place] = *photos_[place]; });
  for (const FramePixels& photo : pixels.frames)
    for (std::size_t i = 3; i < photo.rgba.size() && !pixels.has_alpha; i += 4) pixels.has_alpha = photo.rgba[i] < 255;
  return pixels;
}

}  // namespace cloam
