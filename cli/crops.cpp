// cloam crops: the objects of driving logs as pictures of their own, after the object benchmark of GenAssets.
#include <nlohmann/json.hpp>

#include "cli/commands.h"
#include "cli/stop_signal.h"
#include "models/eval/object_crops.h"
#include "models/scene/split.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr char kCropsExamples[] = R"(Cut the actors of driving logs out of the images, one picture each, with an index.

Examples:
  cloam crops logs/001 -o crops
  cloam crops logs/001 logs/002 -o training --training
  cloam crops logs/003 -o front --protocol sparse --split test
  cloam crops logs/001 -o crops --masks sam      # sam/actors.json, sam/front_camera/00_actor.png, ...
  cloam distance assets/pictures crops --features random

The object benchmark of the GenAssets paper: an actor is kept unless more than 30 % of its LiDAR points are outside of its
mask, or the mask has fewer than 100 pixels; with --training also unless nearer boxes cover more than half of its 2-D box.
Crops are square RGBA images; alpha is the mask. docs/formats.md describes crops.json and the files of --masks.)";

int run_crops(const CropRequest& request, const Common& common) {
  if (!request.how.protocol.name.empty() && request.how.holdout > 0)
    throw Error(Fault::usage, "--protocol and --holdout both choose the training images; give only one");
  const StopOnSignal signals("finishing this image");
  const CropReport report = write_crops(request, listener_of(common));
  if (common.json) {
    nlohmann::ordered_json json = {{"schema_version", 1}, {"folder", request.out}};
    json.update(to_json(report));
    put_json(json, 2);
  } else {
    put(table_of(report, request.filters));
  }
  say(common, text("the crops and crops.json are in ", request.out));
  return 0;
}

}  // namespace

Command add_crops(CLI::App& program) {
  return command<CropRequest>(program, "crops", kCropsExamples, run_crops, [](const Options& add, CropRequest& r) {
    add("LOG", r.logs, "Folders of driving logs").required();
    add("-o,--out", r.out, "New folder for the crops and crops.json", output_folder()).required();
    add("--split", r.split, "Images to use: train, test or all (all)", one_of({"train", "test", "all"}));
    add("--protocol", r.how.protocol.name, "As for train: choose the training images by sparse, novel or rotate360",
        one_of(protocol_names()));
    add("--holdout", r.how.holdout, "As for train: hold out every Nth step", whole_number(2, 1 << 20));
    add("--masks", r.masks, "Folder of actor masks, such as those of SAM (default: truth/ of each log, else boxes)");
    add("--size", r.size, "Width and height of the crops (256)", whole_number(16, 4096));
    add("--training", r.filters.training, "Also reject objects that nearer boxes cover by more than half");
    add("--skip-bad", r.how.skip_bad, "Warn about damaged images, masks and sweeps instead of stopping");
    add_allow_outside(add, r.how.allow_outside);
  });
}

}  // namespace cloam
