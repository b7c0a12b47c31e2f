// See eval_prior.h.
#include "cli/eval_prior.h"

#include <fmt/format.h>

#include <chrono>

#include "models/io/commit.h"
#include "models/train/asset_prior.h"
#include "models/train/restore_run.h"
#include "runtime/error.h"

namespace cloam {
namespace {

void check_options(const EvalRequest& request) {
  const std::pair<const char*, bool> options[] = {{"--data", !request.other.empty()},
                                                  {"--protocol", !request.protocol.empty()},
                                                  {"--features", !request.features.empty()},
                                                  {"--images", !request.images.empty()}};
  for (const auto& [option, given] : options)
    if (given) throw Error(Fault::usage, text(option, " goes with photos, which ", request.run, " did not learn from"));
}

}  // namespace

nlohmann::ordered_json measure_prior(const EvalRequest& request, const Common& common) {
  check_options(request);
  const auto start = std::chrono::steady_clock::now();
  open_device(common);
  const RestoredRun run = restore_run(request.run);
  if (!run.checkpoint.warning.empty()) warn(run.checkpoint.warning);
  AssetPrior& prior = *run.method->prior();
  prior.load(read_source(run));
  const PriorScore score = prior.score();
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  const nlohmann::ordered_json figures = {{"schema_version", 1},
                                          {"protocol", "held-out-codes"},
                                          {"codes", score.codes},
                                          {"training_codes", score.training_codes},
                                          {"v_loss", score.v_loss},
                                          {"baseline_zero_v_loss", score.zero_v_loss},
                                          {"floor_v_loss", score.floor_v_loss},
                                          {"training_v_loss", score.training_v_loss},
                                          {"method", run.record.method},
                                          {"preset", run.record.preset},
                                          {"step", run.progress.step},
                                          {"seconds", seconds}};
  commit_text(RunPaths{request.run}.eval() / "eval.json", figures.dump(2) + "\n");
  return figures;
}

std::string prior_table(const nlohmann::ordered_json& f) {
  const auto row = [&](const char* what, const char* key) {
    return fmt::format("{:<28}{:.4f}\n", what, f.at(key).get<double>());
  };
  return fmt::format("{} codes held out, {} trained on, step {}\n", f.at("codes").get<int64_t>(),
                     f.at("training_codes").get<int64_t>(), f.at("step").get<int64_t>()) +
         row("v-loss", "v_loss") + row("of predicting zero", "baseline_zero_v_loss") +
         row("of knowing their means", "floor_v_loss") + row("on the training codes", "training_v_loss");
}

}  // namespace cloam
