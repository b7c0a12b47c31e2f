// The captures of a run, read and checked as a whole before anything is made from them.
#pragma once
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "models/data/load_images.h"
#include "models/runs/run_folder.h"
#include "models/train/method.h"

namespace cloam {

struct Capture {
  Scene scene;
  PhotoStore train, test;
  std::vector<std::string> warnings;
  RestingScene resting = {};  // the scene again, for a training; of a driving log packed
};

using Captures = std::vector<Capture>;

/// How a command reads data for a run. What the user allowed when it was trained holds for its own data; `other` data
/// are allowed nothing but what this call allows.
Reading reading_for(const RunRecord& record, bool other, bool allow_outside);

/// The capture with its split; images are not read. Fault::data, Fault::usage.
Scene read_split_scene(const std::filesystem::path& data, const Reading& how);

/// What photos have to learn from.
struct PhotoUse {
  bool pixels = false;  // one that counts: no mask leaves it out, nor is it clear
  bool depths = false;  // a pixel with a depth
};
PhotoUse use_of(const FramePixels& photo);

/// Fault::data, with what to do, where no photo trains. train: those of the scene that do.
void require_training_photos(const Scene& scene, const PhotoStore& train);

/// Fault::data, with what to do, where masks leave no pixel of any of these photos. Decodes them until one has some.
void require_unmasked(const Scene& scene, const PhotoStore& train);

/// The capture with the split of its source.
Scene read_scene_as_listed(const std::filesystem::path& data, const Reading& how);

/// Is told how many captures are done of all ("listed", "read", "decoded"), by one thread at a time.
using CapturesTold = std::function<void(const std::string& what, std::size_t done, std::size_t all)>;

/// Where images are held: those that train in the store, as far as it has room. device_budget: of a method that puts
/// all that train on the device, the bytes that it may take; 0: no method does.
struct ImageMemory {
  std::shared_ptr<HostStore> store;
  uint64_t device_budget = 0;
  bool depths = false;  // depth maps of photos that train, too
};

/// Lists every image that trains or is measured. Where the store has room for all that train, every image is decoded
/// now, so that damaged ones are told before anything begins; else their headers alone are read, and a damaged one is
/// told when it is asked for. Fault::memory, before reading, if those that train do not fit on the device. Fault::data
/// for a capture that leaves nothing to train on. Of several that are wrong the first in `data` is told.
Captures read_captures(const std::vector<std::filesystem::path>& data, const Reading& how, const ImageMemory& memory,
                       const CapturesTold& told);

Scenes scenes_of(const Captures& captures);

/// Adds to the warnings of each what the method of that name, once built, makes of captures of this kind.
void add_warnings(Captures& captures, const std::string& name, Method& method);

/// Bytes of the loaded images (8-bit RGBA) of one split at a downscale.
uint64_t image_bytes(const Scene& scene, Split split, int downscale);

/// "50 images 1080x1920", "held out 7 (every 8th)", the lens, one line each.
std::vector<std::string> describe(const Scene& scene, const Reading& how);

}  // namespace cloam
