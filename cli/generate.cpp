// cloam generate: new assets from a run of diffusion, decoded by the run that it learned from.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>

#include "cli/commands.h"
#include "cli/stop_signal.h"
#include "models/eval/pictures.h"
#include "models/io/commit.h"
#include "models/io/gif.h"
#include "models/io/words.h"
#include "models/latents/generates_assets.h"
#include "models/latents/new_assets.h"
#include "models/latents/shows_assets.h"
#include "models/mesh/write_mesh.h"
#include "models/runs/actor_names.h"
#include "models/street/asset_mesh.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

const std::map<std::string, CodeSource> kCodeSources = {
    {"sampled", CodeSource::sampled}, {"random", CodeSource::random}, {"training", CodeSource::training}};

constexpr int kFramesPerSecond = 12;
constexpr char kPictures[] = "pictures", kGrid[] = "grid.png", kRecord[] = "generate.json";
constexpr char kExamples[] = R"(Generate new assets with a diffusion run.

Examples:
  cloam generate runs/assets -n 16 -o assets
  cloam generate runs/assets -n 4 --class Car --time night --seed 7 --guidance 2 -o cars
  cloam generate runs/assets -n 60 --pictures --no-meshes --codes random -o random    a baseline to compare
  cloam distance random/pictures training/pictures --features random                  samples with

Writes latents.safetensors, grid.png, generate.json and, for each asset, a turntable (GIF) and a mesh (GLB). The same seed
gives the same files. Without --class and --time, both are drawn as often as they occur in the training data. Each asset
takes the box of the training actor of its class with the nearest code.)";

struct GenerateRequest {
  std::string run, out, asset_class, time, codes = "sampled";
  AssetWish wish;
  bool pictures = false, no_meshes = false;
  int frames = 12, size = 128, resolution = 96;
};

/// The assets in the street that shows them, and how they were made.
struct Made {
  Street& street;
  std::vector<NewAsset> assets;
  std::vector<AssetName> names;
  Json how;
};

int class_named(const std::string& given) {
  const std::vector<std::string> names(std::begin(kAssetClasses), std::end(kAssetClasses));
  for (std::size_t i = 0; i < names.size(); ++i)
    if (lower_case(names[i]) == lower_case(given)) return static_cast<int>(i);
  throw Error(Fault::usage, text("--class ", given, ": want one of ", joined(names), did_you_mean(given, names)));
}

const char* time_of_day(bool night) { return night ? "night" : "day"; }

/// Nothing of when, where and by whom: equal runs and seeds give equal bytes.
Json how_made(const GenerateRequest& request, const RestoredRun& prior, const StoredRun& source) {
  const AssetWish& wish = request.wish;
  return {{"version", kVersion},
          {"seed", wish.seed},
          {"guidance", wish.guidance},
          {"steps", wish.steps},
          {"codes", request.codes},
          {"class", wish.asset_class ? kAssetClasses[*wish.asset_class] : "as in training"},
          {"time", wish.night ? time_of_day(*wish.night) : "as in training"},
          {"prior", fingerprint(prior)},
          {"prior_settings", prior.record.settings},
          {"decoder", fingerprint(source)},
          {"decoder_settings", source.record.settings}};
}

Json described(const Made& made, std::size_t i) {
  const NewAsset& asset = made.assets[i];
  return {{"asset", i},
          {"class", kAssetClasses[asset.asset_class]},
          {"time", time_of_day(asset.night)},
          {"size_m", {asset.size.x(), asset.size.y(), asset.size.z()}}};
}

fs::path file_of(const GenerateRequest& request, std::size_t asset, const char* extension) {
  return fs::path(request.out) / fmt::format("asset_{:03}.{}", asset, extension);
}

void write_latents(const fs::path& path, const Made& made, const std::array<int64_t, 2>& shape) {
  NewAssets all{made.assets, shape, {}};
  for (const auto& [key, value] : made.how.items())
    all.made[key] = value.is_string() ? value.get<std::string>() : value.dump();
  write_new_assets(path, all);
}

/// The mesh's file, or none (and a warning) where the asset has no surface.
void add_mesh(const GenerateRequest& request, const Made& made, std::size_t i, Json& row) {
  const NewAsset& asset = made.assets[i];
  const fs::path path = file_of(request, i, "glb");
  const Mesh mesh = asset_mesh(made.street, made.names[i], asset.size, request.resolution);
  if (mesh.triangle_count() == 0) {
    std::error_code error;
    fs::remove(path, error);  // of an earlier generation
    return warn(text("asset ", i, " has no surface in its box: no mesh is written"));
  }
  MeshLabel label{text("generated ", kAssetClasses[asset.asset_class], " ", i), described(made, i)};
  label.extras["resolution"] = request.resolution;
  label.extras.update(made.how);
  write_glb(path, mesh, label);
  row["mesh"] = path.filename().string();
  row["vertices"] = mesh.vertex_count();
  row["triangles"] = mesh.triangle_count();
}

/// For `distance`, which wants no loops but pictures.
void write_pictures(const GenerateRequest& request, std::size_t asset, const std::vector<Image>& turn) {
  for (std::size_t i = 0; i < turn.size(); ++i) {
    write_png(fs::path(request.out) / kPictures / fmt::format("asset_{:03}_{:04}.png", asset, i), turn[i]);
  }
}

/// Turntables, meshes and the grid; returns what there is of each asset.
Json write_assets(const GenerateRequest& request, const Made& made, const Common& common) {
  Json rows = Json::array();
  std::vector<Image> grid;
  const StopOnSignal signals("finishing this asset");
  std::vector<Caption> captions;
  for (std::size_t i = 0; i < made.assets.size(); ++i) {
    check_stop([&] {
      return text(i, " of ", made.assets.size(), " assets are complete in ", request.out, ", without ", kGrid, " and ",
                  kRecord);
    });
    Json row = described(made, i);
    const std::vector<Image> turn =
        turntable(made.street, made.names[i], made.assets[i].size, request.frames, request.size);
    const fs::path gif = file_of(request, i, "gif");
    Json how = row;
    how.update(made.how);
    write_gif(gif, turn, kFramesPerSecond, how.dump());
    row["turntable"] = gif.filename().string();
    grid.push_back(three_quarter_picture(made.street, made.names[i], made.assets[i].size, request.size));
    captions.push_back({text(i, "  ", kAssetClasses[made.assets[i].asset_class]), time_of_day(made.assets[i].night)});
    if (request.pictures) write_pictures(request, i, turn);
    if (!request.no_meshes) add_mesh(request, made, i, row);
    say(common, text("generate ", i + 1, "/", made.assets.size(), "  ", kAssetClasses[made.assets[i].asset_class], ", ",
                     time_of_day(made.assets[i].night)));
    rows.push_back(row);
  }
  const int columns = static_cast<int>(std::ceil(std::sqrt(static_cast<double>(grid.size()))));
  write_png(fs::path(request.out) / kGrid, contact_sheet(grid, columns, captions), made.how.dump());
  warn_without_font();
  return rows;
}

int run_command(GenerateRequest request, const Common& common) {
  if (!request.asset_class.empty()) request.wish.asset_class = class_named(request.asset_class);
  if (!request.time.empty()) request.wish.night = request.time == "night";
  request.wish.codes = kCodeSources.at(request.codes);
  check_is_prior(read_record(request.run), request.run);
  const RestoredRun prior = restored(request.run, common);
  StoredRun source = read_source(prior);
  as<LearnsFromRun>(*prior.method)->load(source_of(source));
  const Json how = how_made(request, prior, source);
  std::vector<NewAsset> assets = as<GeneratesAssets>(*prior.method)->generate(request.wish);
  const RestoredRun decoder = restore_run(std::move(source));
  Made made{street_of(decoder), std::move(assets), {}, how};
  made.names = as<ShowsAssets>(*decoder.method)->show_assets(made.assets);
  const fs::path folder = request.out;
  std::error_code error;
  // Of an earlier generation, which may have had more; a folder that something else made is left alone.
  if (fs::exists(folder / kRecord, error)) fs::remove_all(folder / kPictures, error);
  write_latents(folder / "latents.safetensors", made, as<GeneratesAssets>(*prior.method)->code_shape());
  Json all = {{"schema_version", 1}, {"made", made.how}};
  all["assets"] = write_assets(request, made, common);
  commit_text(folder / kRecord, all.dump(2) + "\n");
  if (common.json) {
    all["folder"] = request.out;
    put_json(all);
  }
  say(common, text(made.assets.size(), " assets in ", request.out, ", shown together in ", (folder / kGrid).string()));
  return 0;
}

}  // namespace

Command add_generate(CLI::App& program) {
  return command<GenerateRequest>(
      program, "generate", kExamples, run_command, [](const Options& add, GenerateRequest& r) {
        add("RUN", r.run, "Folder of a diffusion run")->required();
        add("-o,--out", r.out, "Folder for the files")->required();
        add("-n,--count", r.wish.count, "Number of assets (1)", whole_number(1, 1000));
        add("--class", r.asset_class, "Car, Truck, Bus, ... (default: as often as in training)");
        add("--time", r.time, "day or night (default: as often as in training)", one_of({"day", "night"}));
        add("--seed", r.wish.seed, "Random seed (0)", whole_number(0));
        add("--guidance", r.wish.guidance, "Classifier-free guidance; above 1 follows class and time more closely (1)",
            number_from(0, 100));
        add("--steps", r.wish.steps, "DDIM denoising steps (50)", whole_number(1));
        add("--codes", r.codes, "sampled, random (the baseline to beat) or training (the codes trained on) (sampled)",
            one_of({"sampled", "random", "training"}));
        add("--pictures", r.pictures, "Also write the turntables' pictures as PNG, to DIR/pictures");
        add("--no-meshes", r.no_meshes, "Write no meshes (GLB)");
        add("--frames", r.frames, "Number of pictures of a turntable (12)", whole_number(1, 10000));
        add("--size", r.size, "Width and height of the pictures (128)", whole_number(16, 4096));
        add("--resolution", r.resolution, "Grid cells along the longest side of a mesh (96)", whole_number(8, 512));
      });
}

}  // namespace cloam
