// See captures.h.
#include "models/runs/captures.h"

#include <algorithm>
#include <mutex>

#include "models/data/read_scene.h"
#include "models/io/in_parallel.h"
#include "models/io/words.h"
#include "models/scene/assets.h"
#include "models/street/street.h"
#include "models/train/capability.h"
#include "models/train/learns_from_captures.h"
#include "runtime/error.h"

namespace cloam {
namespace {

const char* lens_name(const Camera& camera) {
  switch (camera.model) {
    case CameraModel::pinhole:
      return "pinhole";
    case CameraModel::opencv:
      return "OPENCV distortion";
    case CameraModel::fisheye:
      return "fisheye";
    case CameraModel::fov:
      return "FOV lens";
  }
  return "";
}

std::string size_text(const Camera& camera) { return text(camera.width, "x", camera.height); }

/// "2nd", "8th".
std::string ordinal(int number) {
  const int tens = number / 10 % 10, ones = number % 10;
  const char* const endings[] = {"th", "st", "nd", "rd"};
  return text(number, tens != 1 && ones <= 3 ? endings[ones] : "th");
}

std::string split_text(const Scene& scene, const Reading& how) {
  const std::size_t test = frames_of(scene, Split::test).size();
  if (!how.image.empty()) return text("trained on one image: ", how.image);
  if (!how.protocol.name.empty())
    return text("protocol ", how.protocol.name, ": ", frames_of(scene, Split::train).size(), " for training, ", test,
                " for evaluation");
  if (how.holdout > 0)
    return text(test, " held out (every ", ordinal(how.holdout), scene.is_log ? " step)" : " by name)");
  return test > 0 ? text(test, " in the test split of the capture") : "none held out (--holdout 8 holds out every 8th)";
}

std::string camera_text(const Scene& scene) {
  const Camera& first = scene.cameras.front();
  if (scene.cameras.size() > 1) return text(scene.cameras.size(), " sets of intrinsics, the first ", lens_name(first));
  return text(lens_name(first), ", focal length ", first.fx, " pixels at full size");
}

std::size_t masks_in(const Scene& scene) {
  return static_cast<std::size_t>(std::count_if(scene.frames.begin(), scene.frames.end(),
                                                [](const Frame& frame) { return frame.mask.has_value(); }));
}

void check_memory(const Captures& captures, const Reading& how, uint64_t budget) {
  const auto bytes = [&](int downscale) {
    uint64_t sum = 0;
    for (const Capture& capture : captures) sum += image_bytes(capture.scene, Split::train, downscale);
    return sum;
  };
  if (budget == 0 || bytes(how.downscale) <= budget) return;
  int fits = how.downscale;
  while (fits < 64 && bytes(fits) > budget) ++fits;
  throw Error(Fault::memory, text("the images that train alone need ", words_for_bytes(bytes(how.downscale)),
                                  ", the memory budget is ", words_for_bytes(budget), "\n  fix: --downscale ", fits,
                                  " needs ", words_for_bytes(bytes(fits))));
}

/// Test images are looked at once at most: none are held.
void list_images(Capture& capture, const Reading& how, const ImageMemory& memory) {
  LoadOptions options{how.downscale, how.skip_bad, how.masks, memory.depths};
  capture.train = store_images(capture.resting, Split::train, options, memory.store);
  options.depths = false;
  capture.test = store_images(capture.resting, Split::test, options, std::make_shared<HostStore>(0, 0));
  require_training_photos(capture.scene, capture.train);
  capture.warnings = capture.scene.warnings;
  for (const auto& more :
       {capture.train.listed().warnings, capture.test.listed().warnings, check_scene(capture.scene)}) {
    capture.warnings.insert(capture.warnings.end(), more.begin(), more.end());
  }
}

void for_each_capture(const Captures& captures, const std::string& what, const CapturesTold& told,
                      const std::function<void(std::size_t)>& work) {
  std::mutex mutex;
  std::size_t done = 0;
  in_parallel(captures.size(), [&](std::size_t i) {
    work(i);
    const std::lock_guard lock(mutex);
    told(what, ++done, captures.size());
  });
}

/// Decodes all, if those that train can stay.
void decode_what_fits(const Captures& captures, const HostStore& store, const CapturesTold& told) {
  uint64_t bytes = 0;
  for (const Capture& capture : captures) bytes += capture.train.bytes();
  if (bytes > store.budget()) return;
  for (std::size_t i = 0; i < captures.size(); ++i) {
    for (const PhotoStore* photos : {&captures[i].train, &captures[i].test})
      in_parallel(photos->size(), [&](std::size_t place) { (void)(*photos)[place]; });
    told("decoded", i + 1, captures.size());
  }
}

// What it means for a training of a driving log that the method or the log lacks something.
std::vector<std::string> log_warnings(const Scene& scene, const std::string& name, Method& method) {
  std::vector<std::string> warnings;
  if (!scene.is_log) return warnings;
  if (!as<Street>(method))
    return {name +
            " learns static scenes: moving actors will be blurred or leave ghosts; street-gaussians and genassets "
            "model them separately"};
  if (scene.actors.empty())
    warnings.push_back(text("without boxes, ", name,
                            " learns everything as background: whatever moves will be blurred, and ",
                            "there are no actors to edit or to take assets from"));
  if (scene.sweeps.empty())
    warnings.push_back(text("without LiDAR sweeps, ", name, " learns depth from images alone, which is less accurate"));
  return warnings;
}

std::size_t depth_maps_in(const Scene& scene) {
  return static_cast<std::size_t>(std::count_if(scene.frames.begin(), scene.frames.end(),
                                                [](const Frame& frame) { return frame.depth.has_value(); }));
}

std::vector<std::string> depth_warnings(const Scene& scene, const std::string& name, const LearnsFromCaptures& learns) {
  if (learns.uses_depths() || depth_maps_in(scene) == 0) return {};
  return {text("the depth maps of ", depth_maps_in(scene), " photos are not used by ", name)};
}

// Their black pixels become clear, so that methods learn an empty background.
void expect_masks(Scene& scene) {
  const bool any = masks_in(scene) > 0;
  scene.has_alpha |= any;
  if (!any) scene.warnings.push_back("--masks transparent: the capture has no masks");
}

}  // namespace

Reading reading_for(const RunRecord& record, bool other, bool allow_outside) {
  Reading how = record.reading;
  how.allow_outside = allow_outside || (how.allow_outside && !other);
  return how;
}

Scene read_split_scene(const std::filesystem::path& data, const Reading& how) {
  Scene scene = read_scene(data, {how.skip_bad, how.allow_outside});
  if (!scene.is_log) fit_cameras(scene);
  if (how.masks == MaskMeaning::transparent) expect_masks(scene);
  if (how.actors == ActorChoice::road_users) keep_road_users(scene);
  if (how.holdout > 0) apply_holdout(scene, how.holdout);
  if (!how.protocol.name.empty()) apply_protocol(scene, how.protocol);
  if (!how.image.empty()) apply_image(scene, how.image);
  return scene;
}

Scene read_scene_as_listed(const std::filesystem::path& data, const Reading& how) {
  Reading plain = how;
  plain.holdout = 0;
  plain.protocol = {};
  plain.image.clear();
  return read_split_scene(data, plain);
}

PhotoUse use_of(const FramePixels& photo) {
  PhotoUse use;
  for (std::size_t i = 0; i < photo.rgba.size() / 4 && !use.pixels; ++i)
    use.pixels = photo.rgba[4 * i + 3] > 0 && (photo.mask.empty() || photo.mask[i] > 0);
  use.depths = std::any_of(photo.depth.begin(), photo.depth.end(), [](float depth) { return depth > 0; });
  return use;
}

void require_training_photos(const Scene& scene, const PhotoStore& train) {
  if (train.size() > 0) return;
  if (!frames_of(scene, Split::train).empty())
    bad_data(scene.root.string(), ": no images are left to train on: all are damaged; copy them again");
  bad_data(scene.root.string(), ": no images are left to train on: of ", scene.frames.size(), " images ",
           frames_of(scene, Split::test).size(), " are held out and ", frames_of(scene, Split::unused).size(),
           " are unused\n  fix: correct the split of the capture, or choose another with --holdout 8");
}

void require_unmasked(const Scene& scene, const PhotoStore& train) {
  if (masks_in(scene) == 0) return;
  const Frame* masked = nullptr;
  for (std::size_t i = 0; i < train.size(); ++i) {
    if (use_of(*train[i]).pixels) return;
    const Frame& frame = scene.frames[train.listed().frames[i].frame];
    if (!masked && frame.mask) masked = &frame;
  }
  if (!masked) return;
  const Image mask = read_image(scene.root / *masked->mask);
  const int most = mask.pixels.empty() ? 0 : *std::max_element(mask.pixels.begin(), mask.pixels.end());
  const char* fix = most == 0    ? "invert masks that are black where the photo counts, or remove them"
                    : most < 128 ? "multiply all masks: magick mogrify -evaluate multiply 255 masks/*.png"
                                 : "a smaller --downscale, or masks that keep more: one black pixel blackens its block";
  bad_data(scene.root.string(),
           ": the masks keep no pixel of any photo: black is what does not count, and the largest value of ",
           *masked->mask, " is ", most, ", want 255 where the photo counts\n  fix: ", fix);
}

uint64_t image_bytes(const Scene& scene, Split split, int downscale) {
  uint64_t pixels = 0;
  for (const std::size_t index : frames_of(scene, split)) {
    const Camera& camera = scene.cameras[static_cast<std::size_t>(scene.frames[index].camera)];
    pixels += static_cast<uint64_t>(camera.width / downscale) * static_cast<uint64_t>(camera.height / downscale);
  }
  return 4 * pixels;
}

Captures read_captures(const std::vector<std::filesystem::path>& data, const Reading& how, const ImageMemory& memory,
                       const CapturesTold& told) {
  if (how.downscale < 1) throw Error(Fault::usage, text("--downscale ", how.downscale, ": want 1 or more"));
  Captures captures(data.size());
  for_each_capture(captures, "listed", told, [&](std::size_t i) {
    Capture& capture = captures[i];
    capture.scene = read_split_scene(data[i], how);
    capture.resting = capture.scene.is_log ? RestingScene(capture.scene, memory.store) : RestingScene(capture.scene);
  });
  check_memory(captures, how, memory.device_budget);
  for (std::size_t i = 0; i < captures.size(); ++i) {  // the images of one are read by all cores
    list_images(captures[i], how, memory);
    told("read", i + 1, captures.size());
  }
  decode_what_fits(captures, *memory.store, told);
  for (const Capture& capture : captures) require_unmasked(capture.scene, capture.train);
  return captures;
}

Scenes scenes_of(const Captures& captures) {
  Scenes scenes;
  for (const Capture& capture : captures) scenes.push_back(capture.scene);
  return scenes;
}

void add_warnings(Captures& captures, const std::string& name, Method& method) {
  const auto* learns = as<LearnsFromCaptures>(method);
  for (Capture& capture : captures) {
    for (const auto& more : {learns->warnings(capture.scene), log_warnings(capture.scene, name, method),
                             depth_warnings(capture.scene, name, *learns)})
      capture.warnings.insert(capture.warnings.end(), more.begin(), more.end());
  }
}

std::vector<std::string> describe(const Scene& scene, const Reading& how) {
  const Camera& camera = scene.cameras.front();
  std::string images = text(scene.frames.size(), " images ", size_text(camera));
  if (how.downscale > 1)
    images += text(" -> ", size_text(scaled(camera, how.downscale)), " (--downscale ", how.downscale, ")");
  if (scene.has_alpha) images += ", with transparent background";
  const std::size_t masks = masks_in(scene);
  if (masks > 0)
    images +=
        text(", ", masks, " masks ", how.masks == MaskMeaning::ignore ? "(black is ignored)" : "(black is empty)");
  if (depth_maps_in(scene) > 0) images += text(", ", depth_maps_in(scene), " depth maps");
  std::string format = text("format ", scene.format);
  if (scene.other_actors > 0)
    format += text(", ", scene.actors.size(), " actors; ", scene.other_actors,
                   " boxes of other labels are background (--actors all makes them assets)");
  if (scene.cloud.count() > 0) format += text(", ", scene.cloud.count(), " points");
  return {images, split_text(scene, how), camera_text(scene), format};
}

}  // namespace cloam
