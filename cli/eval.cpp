// cloam eval: PSNR and SSIM on photos that were held out, beside what trivial guesses score; of driving logs also over
// actors alone, and the LiDAR's depths.
#include "cli/eval.h"

#include <nlohmann/json.hpp>
#include <optional>

#include "cli/commands.h"
#include "cli/ranks.h"
#include "cli/stop_signal.h"
#include "models/eval/measure_run.h"
#include "models/eval/prior_figures.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr char kEvalExamples[] = R"(Measure a run on held-out photos: PSNR, SSIM and baselines.

Examples:
  cloam eval runs/fox
  cloam eval runs/fox --json
  cloam eval runs/fox --downscale 8                         at another size than that of the training
  cloam eval runs/fox --data data/fox-evening --images pictures
  cloam eval runs/street --protocol novel
  cloam eval runs/street --protocol rotate360 --features squeezenet.npz
  cloam eval runs/street --lpips alexnet-owt-7be5be79.pth,alex.pth
  cloam eval runs/assets                                    a diffusion run: its loss on held-out codes
  cloam eval runs/assets --features squeezenet.npz --photos crops     its samples against photographs (cloam crops))";

void check_options(const EvalRequest& request) {
  const std::pair<const char*, bool> options[] = {{"--data", !request.other.empty()},
                                                  {"--protocol", !request.protocol.empty()},
                                                  {"--lpips", !request.lpips.empty()},
                                                  {"--images", !request.images.empty()},
                                                  {"--downscale", request.downscale.has_value()}};
  for (const auto& [option, given] : options)
    if (given) throw Error(Fault::usage, text(option, " is for runs trained on images; ", request.run, " was not"));
  if (!request.photos.empty() && request.features.empty())
    throw Error(Fault::usage, "--photos also needs --features: pictures are compared by the features of a network");
}

nlohmann::ordered_json measure_prior(const EvalRequest& request, const Common& common) {
  check_options(request);
  const StopOnSignal signals("finishing this asset");
  const RestoredRun run = restored(request.run, common);
  std::optional<FeatureNetwork> network;
  std::optional<PhotoCrops> photos;
  if (!request.features.empty()) network = features_named(request.features);
  if (!request.photos.empty()) photos = read_photo_crops(request.photos);
  return measure_prior(run, {network ? &*network : nullptr, photos ? &*photos : nullptr}, listener_of(common), ranks());
}

EvalResult measure_photos(const EvalRequest& request, const Common& common) {
  if (!request.photos.empty())
    throw Error(Fault::usage, text("--photos is for diffusion runs; ", request.run, " is none"));
  RestoredRun run = restored(request.run, common);
  if (run.record.edited_from && request.other.empty())
    warn(text(request.run, " is an edited run: its pictures are compared with photos of the street before the edit"));
  const StopOnSignal signals("finishing this picture");
  return measure_run(request, run, listener_of(common), ranks());
}

int run_eval(const EvalRequest& request, const Common& common) {
  if (learned_from_run(read_record(request.run))) {
    const auto figures = measure_prior(request, common);
    common.json ? put_json(figures, 2) : put(prior_table(figures));
    return 0;
  }
  const EvalResult result = measure_photos(request, common);
  common.json ? put_json(to_json(result), 2) : put(table(result));
  say(common, text("pictures ", pictures_of(request).string(), "  (render | photo | error x4)"));
  return 0;
}

}  // namespace

nlohmann::ordered_json measure_run(const EvalRequest& request, const Common& common) {
  if (learned_from_run(read_record(request.run))) return measure_prior(request, common);
  return to_json(measure_photos(request, common));
}

Command add_eval(CLI::App& program) {
  return command<EvalRequest>(program, "eval", kEvalExamples, run_eval, [](const Options& add, EvalRequest& r) {
    add("RUN", r.run, "Run folder").required();
    add("--data", r.other, "Other photos in the same coordinate frame: their test split, or all");
    add_allow_outside(add, r.allow_outside);
    add("--protocol", r.protocol, "Driving logs: sparse, novel or rotate360 (default: the run's)",
        one_of(protocol_names()));
    add("--features", r.features, "Also measure feature distances; a file with network weights, or random");
    add("--photos", r.photos, "Diffusion runs: also measure samples against these crops of photographs (cloam crops)");
    add("--lpips", r.lpips, "Also measure LPIPS: weights of AlexNet or VGG-16, a comma, those of the linear layers");
    add("--downscale", r.downscale, "Shrink the photos by this factor instead of the training's", whole_number(1, 256));
    add("--images", r.images, "Folder for the pictures (RUN/eval/images)", output_folder());
  });
}

}  // namespace cloam
