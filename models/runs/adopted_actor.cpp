// See adopted_actor.h.
#include "models/runs/adopted_actor.h"

#include <algorithm>

#include "models/gaussians/adopts_actors.h"
#include "models/gaussians/exports_actors.h"
#include "models/methods/registry.h"
#include "runtime/error.h"

namespace cloam {
namespace {

template <class Capability>
void check_has(const StoredRun& run) {
  if (has<Capability>(run.record.method)) return;
  throw Error(Fault::usage, text("looks go from run to run where actors are Gaussians of their own, and ",
                                 run.folder.string(), " is a run of ", run.record.method,
                                 "\n  fix: replace=[LOG:]ID takes those of another actor of its own"));
}

/// The id, with a number where the log has it already.
std::string new_id(const Scene& scene, const std::string& wanted) {
  const auto taken = [&](const std::string& id) {
    return std::any_of(scene.actors.begin(), scene.actors.end(), [&](const Actor& actor) { return actor.id == id; });
  };
  std::string id = wanted;
  for (int copy = 2; taken(id); ++copy) id = text(wanted, "-", copy);
  return id;
}

}  // namespace

std::filesystem::path run_named_in(const std::string& operand) {
  for (std::size_t colon = operand.find(':'); colon != std::string::npos; colon = operand.find(':', colon + 1))
    if (is_run(operand.substr(0, colon))) return operand.substr(0, colon);
  return {};
}

Replace adopt_actor(StoredRun& run, const StoredRun& other, const AssetName& name) {
  check_has<AdoptsActors>(run);
  check_has<ExportsActors>(other);
  const Replace looks = replace_by(other.scenes, name);
  const RestoredRun theirs = restore_run(other);
  const Gaussians gaussians = as<ExportsActors>(*theirs.method)->actor_gaussians(looks.appearance);
  if (gaussians.count() == 0)
    throw Error(Fault::data, text("actor ", name.actor_id, " of ", other.folder.string(), " has no Gaussians"));
  Actor actor = actor_of(other.scenes, name);
  Scene& scene = run.scenes.front();
  actor.id = new_id(scene, actor.id);
  actor.boxes.clear();
  actor.asset.reset();
  scene.actors.push_back(actor);
  const RestoredRun ours = restore_run(run);
  as<AdoptsActors>(*ours.method)->adopt(scene.actors.size() - 1, gaussians);
  run.checkpoint.file = checkpoint_of(*ours.method, ours.progress, checkpoint_metadata(run.record));
  run.checkpoint.path.clear();
  return {{0, actor.id}, looks.size};
}

}  // namespace cloam
