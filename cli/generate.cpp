// cloam generate: new assets from a run of diffusion, decoded by the run that it learned from.
#include <map>
#include <nlohmann/json.hpp>

#include "cli/commands.h"
#include "cli/ranks.h"
#include "cli/shipped.h"
#include "cli/stop_signal.h"
#include "cli/terminal_picture.h"
#include "models/eval/asset_files.h"
#include "models/io/words.h"
#include "models/scene/asset_class.h"
#include "runtime/error.h"

namespace cloam {
namespace {

using Report = nlohmann::ordered_json;

const std::map<std::string, CodeSource> kCodeSources = {{"sampled", CodeSource::sampled},
                                                        {"gaussian", CodeSource::gaussian},
                                                        {"mean", CodeSource::mean},
                                                        {"random", CodeSource::random},
                                                        {"training", CodeSource::training}};

constexpr char kCodesHelp[] =
    "sampled; to compare: gaussian (of class and time of day), mean (of that), random (white noise) and training (the "
    "codes trained on) (sampled)";

constexpr char kGenerateExamples[] = R"(Generate new assets with a diffusion run.

Examples:
  cloam generate -n 16 -o assets                               with the prior that comes with the program
  cloam generate runs/assets -n 16 -o assets
  cloam generate runs/assets -n 4 --class Car --time night --seed 7 --guidance 2 -o cars
  cloam generate runs/assets -n 60 --pictures --no-meshes --codes gaussian -o gaussian    a baseline to compare
  cloam distance gaussian/pictures training/pictures --features random                    samples with

Writes latents.safetensors, grid.png, generate.json and, for each asset, a turntable (GIF) and a mesh (GLB). The same seed
gives the same files. Without --class and --time, both are drawn as often as they occur in the training data. Each asset
takes the box of the training actor of its class with the nearest code. Memory does not grow with their number; grid.png
shows the first 256.)";

struct GenerateRequest {
  std::string run = kShipped, asset_class, time, codes = "sampled";
  AssetRequest wish;
  AssetFiles files;
  std::string out, show;
  bool no_meshes = false;
};

int class_named(const std::string& given) {
  const std::vector<std::string> names(std::begin(kAssetClasses), std::end(kAssetClasses));
  for (std::size_t i = 0; i < names.size(); ++i)
    if (lower_case(names[i]) == lower_case(given)) return static_cast<int>(i);
  throw Error(Fault::usage, text("--class ", given, ": want one of ", joined(names), did_you_mean(given, names)));
}

int run_generate(GenerateRequest request, const Common& common) {
  if (!request.asset_class.empty()) request.wish.asset_class = class_named(request.asset_class);
  if (!request.time.empty()) request.wish.night = request.time == "night";
  request.wish.codes = kCodeSources.at(request.codes);
  request.files.folder = request.out;
  request.files.meshes = !request.no_meshes;
  request.run = prior_named(request.run);
  check_is_prior(read_record(request.run), request.run);
  const RestoredRun prior = restored(request.run, common);
  Generation made(prior, request.wish, {kVersion, request.codes});
  const StopOnSignal signals("finishing this asset");
  Report all = write_assets(made, request.files, listener_of(common), ranks());
  if (ranks().rank() > 0) return 0;
  warn_without_font();
  if (common.json) {
    all["folder"] = request.out;
    put_json(all);
  }
  say(common,
      text(all["assets"].size(), " assets in ", request.out, ", shown together in ", request.files.grid().string()));
  show_picture(request.show, request.files.grid(), common);
  return 0;
}

}  // namespace

Command add_generate(CLI::App& program) {
  return command<GenerateRequest>(
      program, "generate", kGenerateExamples, run_generate, [](const Options& add, GenerateRequest& r) {
        add("RUN", r.run, "Folder of a diffusion run (shipped: the one that comes with the program)");
        add("-o,--out", r.out, "Folder for the files").required();
        add("-n,--count", r.wish.count, "Number of assets (1)", whole_number(1, kAllCodes));
        add("--class", r.asset_class, "Car, Truck, Bus, ... (default: as often as in training)");
        add("--time", r.time, "day or night (default: as often as in training)", one_of({"day", "night"}));
        add("--seed", r.wish.seed, "Random seed (0)", whole_number(0));
        add("--guidance", r.wish.guidance, "Classifier-free guidance; above 1 follows class and time more closely (1)",
            number_from(0, 100));
        add("--steps", r.wish.steps, "DDIM denoising steps (50)", whole_number(1));
        add("--codes", r.codes, kCodesHelp, one_of({"sampled", "gaussian", "mean", "random", "training"}));
        add("--pictures", r.files.pictures, "Also write the turntables' pictures as PNG, to DIR/pictures");
        add_show(add, r.show);
        add("--no-meshes", r.no_meshes, "Write no meshes (GLB)");
        add("--frames", r.files.frames, "Number of pictures of a turntable (12)", whole_number(1, 10000));
        add("--size", r.files.size, "Width and height of the pictures (128)", whole_number(16, 4096));
        add("--resolution", r.files.resolution, "Grid cells along the longest side of a mesh (96)",
            whole_number(8, 512));
      });
}

}  // namespace cloam
