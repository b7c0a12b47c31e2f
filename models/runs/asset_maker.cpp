// See asset_maker.h.
#include "models/runs/asset_maker.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "models/io/host_random.h"
#include "models/latents/generates_assets.h"
#include "models/runs/actor_names.h"
#include "models/scene/asset_class.h"
#include "models/train/shares_networks.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr int kCandidates = 8;

void check_same_networks(const StoredRun& prior, const StoredRun& source, const StoredRun& run) {
  const auto networks = [](const StoredRun& of) { return networks_in(parameters_in(of.checkpoint.file)); };
  if (networks(source) == networks(run)) return;
  throw Error(Fault::data, text(prior.folder.string(), " learned from ", source.folder.string(),
                                ", whose networks are not those of ", run.folder.string(),
                                ": its codes mean nothing to them\n  fix: cloam train diffusion ", run.folder.string(),
                                " -o RUN2, and name RUN2"));
}

/// How far the sides of two boxes are apart: the largest ratio, as a logarithm.
double misfit(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return (a.array() / b.array()).log().abs().maxCoeff();
}

/// One for each actor of a run.
uint64_t seed_of(const StoredRun& run, const AssetName& name, uint64_t seed) {
  const std::vector<Actor>& actors = run.scenes.at(static_cast<std::size_t>(name.scene)).actors;
  const auto place = static_cast<uint64_t>(&actor_of(run.scenes, name) - actors.data());
  return HostRandom(seed, static_cast<uint64_t>(name.scene) << 32 | place).next();
}

std::vector<AssetName> vehicles_of(const Scenes& scenes, int log) {
  std::vector<AssetName> names;
  for (const Actor& actor : scenes.at(static_cast<std::size_t>(log)).actors)
    if (!actor.boxes.empty() && is_vehicle(asset_class(actor.label))) names.push_back({log, actor.id});
  return names;
}

}  // namespace

AssetMaker::AssetMaker(const std::filesystem::path& prior, const StoredRun& run) {
  check_is_prior(read_record(prior), prior);
  prior_ = restore_run(prior);
  check_same_networks(prior_, load_source(prior_), run);
}

Replace AssetMaker::make(StoredRun& run, const AssetName& name, const MakerRequest& wish) {
  const Actor& actor = actor_of(run.scenes, name);
  auto& prior = *as<GeneratesAssets>(*prior_.method);
  const AssetRequest wanted = {.count = kCandidates,
                               .asset_class = asset_class(actor.label),
                               .night = run.scenes[static_cast<std::size_t>(name.scene)].night,
                               .seed = seed_of(run, name, wish.seed),
                               .guidance = wish.guidance};
  const std::vector<NewAsset> candidates = prior.generate(wanted);
  const auto best = std::min_element(candidates.begin(), candidates.end(), [&](const NewAsset& a, const NewAsset& b) {
    return misfit(a.size, actor.size) < misfit(b.size, actor.size);
  });
  const AssetName appearance = added_asset(run.scenes.size(), run.generated.assets.size());
  const nlohmann::ordered_json how = {{"log", name.scene}, {"actor", name.actor_id},    {"prior", fingerprint(prior_)},
                                      {"seed", wish.seed}, {"guidance", wish.guidance}, {"steps", wanted.steps}};
  run.generated.shape = prior.code_shape();
  run.generated.made[text("asset.", run.generated.assets.size())] =
      how.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
  run.generated.assets.push_back(*best);
  return {appearance, best->size};
}

std::size_t swap_vehicles(AssetMaker& maker, const MakerRequest& wish, int log, StoredRun& run,
                          const std::function<void(int, const std::string&)>& left_out) {
  std::size_t swapped = 0;
  for (const AssetName& name : vehicles_of(run.scenes, log)) {
    try {
      apply(maker.make(run, name, wish), run.scenes, name);
      ++swapped;
    } catch (const Error& error) {
      if (error.fault() != Fault::usage) throw;
      left_out(asset_class(actor_of(run.scenes, name).label), error.what());
    }
  }
  if (swapped > 0) return swapped;
  throw Error(Fault::data, "no vehicle of the log can be replaced: the --prior run learned none of their classes");
}

}  // namespace cloam
