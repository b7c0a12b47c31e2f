// The photos of one split of a capture: what they are, at once; their pixels when asked for, from memory or from disk.
#pragma once
#include <functional>
#include <memory>

#include "models/io/host_store.h"
#include "models/scene/pixels.h"

namespace cloam {

/// What some of the photos have beside colours.
struct PhotoPlanes {
  bool masks = false, depths = false;
};

class PhotoStore {
 public:
  /// All in memory.
  PhotoStore(Pixels pixels);  // NOLINT: pixels in memory are photos
  PhotoStore() : PhotoStore(Pixels{}) {}
  /// listed: the photos without pixels, at the size they are loaded at. load(outline): one of them with its pixels;
  /// called by several threads at once.
  PhotoStore(Pixels listed, const PhotoPlanes& planes,
             const std::function<FramePixels(const FramePixels& outline)>& load, std::shared_ptr<HostStore> store);

  /// Cameras, frames and sizes; without pixels.
  const Pixels& listed() const { return *listed_; }
  std::size_t size() const { return listed_->frames.size(); }
  const PhotoPlanes& planes() const { return planes_; }
  /// As many bytes as all of them have in memory.
  uint64_t bytes() const;
  /// The photo with its pixels. Fault::data for a file that is damaged.
  std::shared_ptr<const FramePixels> operator[](std::size_t place) const { return photos_[place]; }
  /// Null: all are in memory.
  const std::shared_ptr<HostStore>& store() const { return photos_.store(); }
  /// As HostStore::want and begin.
  void want(std::size_t place, int64_t moment) const { photos_.want(place, moment); }
  void begin(int64_t moment) const { photos_.begin(moment); }
  /// All, for methods that put them on the device.
  Pixels all() const;

 private:
  std::shared_ptr<const Pixels> listed_;  // photos_ needs it, too
  PhotoPlanes planes_;
  Stored<FramePixels> photos_;
};

}  // namespace cloam
