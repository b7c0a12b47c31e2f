// See pack_prior.h.
#include "models/runs/pack_prior.h"

#include <fmt/format.h>

#include <cmath>

#include "models/io/checkpoint.h"
#include "models/io/packed_tensors.h"
#include "models/io/paths.h"
#include "models/io/words.h"
#include "models/methods/code_set.h"
#include "models/runs/scene_file.h"
#include "models/scene/asset_class.h"
#include "models/train/shares_networks.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr char kNetworksFolder[] = "networks", kAssetsFolder[] = "assets", kGiven[] = "../networks";

/// Codes [begin, end) of the source that share a time of day: neighbours, so that their order stays.
struct Gallery {
  std::size_t begin = 0, end = 0;
  bool night = false;
};

std::vector<Gallery> galleries_of(const AssetCodes& codes) {
  std::vector<Gallery> all;
  for (std::size_t i = 0; i < codes.count(); ++i) {
    const bool night = codes.nights[i] == 1;
    if (all.empty() || all.back().night != night) all.push_back({i, i, night});
    all.back().end = i + 1;
  }
  return all;
}

/// Of a log of that time of day its first camera, which says where up is; boxes that nothing moves.
Scene scene_of(const Gallery& gallery, const AssetCodes& codes, const Scene& like) {
  Scene scene;
  scene.format = like.format;
  scene.up = like.up;
  scene.metric = like.metric;
  scene.is_log = true;
  scene.night = gallery.night;
  scene.cameras = like.cameras;
  scene.frames = {like.frames.front()};
  scene.frames.front().image = scene.frames.front().name = "none";
  scene.frames.front().mask.reset();
  for (std::size_t i = gallery.begin; i < gallery.end; ++i) {
    Actor actor;
    actor.id = fmt::format("{:05}", i);
    actor.label = kAssetClasses[codes.classes[i]];
    actor.size = codes.sizes[i];
    scene.actors.push_back(actor);
  }
  return scene;
}

/// Rows of means, and of log variances where codes have them, as the method holds them.
std::vector<float> rows_of(const Gallery& gallery, const AssetCodes& codes) {
  const std::size_t numbers = codes.means.size() / codes.count();
  std::vector<float> rows;
  for (std::size_t i = gallery.begin * numbers; i < gallery.end * numbers; i += numbers) {
    for (std::size_t k = i; k < i + numbers; ++k) rows.push_back(codes.means[k]);
    for (std::size_t k = i; k < i + numbers && !codes.deviations.empty(); ++k)
      rows.push_back(2 * std::log(codes.deviations[k]) - kCodeLogVariance);
  }
  return rows;
}

std::size_t first_log(const Scenes& scenes, bool night) {
  for (std::size_t log = 0; log < scenes.size(); ++log)
    if (scenes[log].night == night) return log;
  return 0;
}

/// What no path of the machine that trained it is in.
RunRecord handed_on(const RunRecord& record) {
  RunRecord out = record;
  out.state = "finished";
  out.command_line = "cloam export RUN --format prior";
  out.data.clear();
  out.networks.reset();
  out.prior.reset();
  out.reading = {};
  if (out.settings.contains("perceptual.weights")) out.settings["perceptual.weights"] = "";
  if (out.settings.contains(kNetworksFrozen)) out.settings[kNetworksFrozen] = "false";
  return out;
}

void write_run(const fs::path& folder, const RunRecord& record, const Scenes& scenes, const SafetensorsFile& file,
               int64_t step) {
  const RunPaths paths{folder};
  fs::create_directories(paths.checkpoints());
  write_scenes(paths.scene(), scenes);
  save_checkpoint(paths.checkpoints(), step, pack(file));
  write_record(folder, record);
}

void write_networks(const StoredRun& source, const AssetCodes& codes, const fs::path& folder) {
  RunRecord record = handed_on(source.record);
  const std::vector<Gallery> galleries = galleries_of(codes);
  Scenes scenes;
  for (const Gallery& gallery : galleries) {
    record.data.push_back({gallery.night ? "night" : "day", "", ""});
    scenes.push_back(scene_of(gallery, codes, source.scenes[first_log(source.scenes, gallery.night)]));
  }
  Config config;
  const std::unique_ptr<Method> method = configured_method(record, config);
  method->build(scenes, record.seed);
  const TensorMap given = parameters_in(source.checkpoint.file);
  std::vector<std::pair<Tensor, Tensor>> updates;
  TensorMap steps;
  for (const auto& [name, p] : method->parameters()) {
    const bool of_networks = name.starts_with(kNetworks);
    updates.push_back({p, of_networks ? tensor_from(given, name, p.shape()) : zeros(p.shape())});
  }
  for (std::size_t i = 0; i < galleries.size(); ++i) {
    const std::string log = text("log", i, "."), like = text("log", first_log(source.scenes, galleries[i].night), ".");
    const Tensor& rows = method->parameters().at(log + "codes");
    updates.push_back({rows, from_host(rows_of(galleries[i], codes), rows.shape())});
    const std::string sky = "common.background";
    if (const auto found = method->parameters().find(log + sky); found != method->parameters().end())
      updates.push_back({found->second, tensor_from(given, like + sky, found->second.shape())});
    const int64_t actors = rows.dim(0);
    steps[row_steps_name(log + "codes")] =
        named(from_host(std::vector<int32_t>(static_cast<std::size_t>(actors), 1 << 30), {actors}));
  }
  assign(updates);
  Progress progress;
  progress.step = source.checkpoint.step;
  progress.horizon = std::max(record.horizon, record.step);
  progress.seed = record.seed;
  SafetensorsFile file = checkpoint_of(*method, progress, checkpoint_metadata(record));
  file.tensors.merge(steps);
  write_run(folder, record, scenes, file, progress.step);
}

/// The EMA in the place of the weights too: nothing else reads these again.
void write_assets(const StoredRun& prior, const fs::path& folder) {
  RunRecord record = handed_on(prior.record);
  const StoredRun networks = read_run(folder.parent_path() / kNetworksFolder);
  record.data = {{kGiven, kGiven, fingerprint(networks)}};
  SafetensorsFile file;
  file.metadata = prior.checkpoint.file.metadata;
  for (const auto& [name, tensor] : prior.checkpoint.file.tensors) {
    if (name.starts_with("state.")) file.tensors[name] = tensor;
    if (name.starts_with("state.ema.")) file.tensors["param." + name.substr(std::string("state.ema.").size())] = tensor;
  }
  write_run(folder, record, networks.scenes, file, prior.checkpoint.step);
}

}  // namespace

void pack_prior(const StoredRun& prior, const fs::path& folder) {
  check_is_prior(prior.record, prior.folder);
  if (!entries_of(folder).empty())
    throw Error(Fault::usage, text(folder.string(), " is not empty; name another folder with -o"));
  const StoredRun source = read_source(prior);
  const auto least = number_in<int64_t>(prior.record.settings.at("data.min_steps")).value_or(0);
  write_networks(source, asset_codes(source_of(source), least), folder / kNetworksFolder);
  write_assets(prior, folder / kAssetsFolder);
}

}  // namespace cloam
