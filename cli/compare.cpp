// cloam compare: the evaluations of runs side by side, and the means of those that differ by their seeds alone.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>

#include "cli/commands.h"
#include "cli/eval.h"
#include "models/eval/compared_runs.h"
#include "models/io/json.h"
#include "models/metrics/lpips.h"
#include "models/nn/feature_network.h"
#include "models/scene/split.h"
#include "runtime/error.h"

namespace cloam {
namespace {

using Report = nlohmann::ordered_json;
using Cells = std::vector<std::string>;

constexpr char kCompareExamples[] = R"(Show the evaluations of runs side by side; runs without one are evaluated first.

Examples:
  cloam compare runs/a runs/b
  cloam compare runs/*-seed? --protocol rotate360 --features squeezenet.npz
  cloam compare runs/nerf-* runs/splat-* --across-data
  cloam compare runs/a runs/b --json

Runs with the same data and settings but different seeds are also averaged (mean and standard deviation).)";

struct CompareRequest {
  std::vector<std::string> runs;
  std::string protocol, features, lpips;  // as eval takes them; empty: what RUN/eval holds
  bool across_data = false;               // averages runs of different data, too
};

/// Names of the networks that are asked for; empty: none.
struct Networks {
  std::string features, perceptual;
};

Networks networks_of(const CompareRequest& request) {
  Networks names;
  if (!request.features.empty()) names.features = features_named(request.features).name;
  if (!request.lpips.empty()) names.perceptual = lpips_named(request.lpips).name;
  return names;
}

/// What RUN/eval holds, if it is what was asked for at the training's size and the run has not gone on since.
std::optional<Report> kept_eval(const CompareRequest& request, const ComparedRun& run, const Networks& networks) {
  const fs::path path = RunPaths{run.run}.eval() / "eval.json";
  if (!fs::exists(path)) return {};
  try {
    const Json json = parse_json_file(path);
    const std::string protocol = string(json, "protocol", path.string());
    const bool asked = request.protocol.empty() || request.protocol == protocol;
    const auto holds = [&](const char* key, const std::string& network) {
      return network.empty() || optional_string(json, key, path.string()) == network;
    };
    const bool same = holds("feature_network", networks.features) && holds("perceptual_network", networks.perceptual);
    const bool same_keys = number(json, "schema_version", path.string()) == kEvalSchema;  // of this version
    if (!asked || !same || !same_keys || number(json, "step", path.string()) < static_cast<double>(run.record.step))
      return {};
    Report kept(json);
    if (figure(kept, "downscale").value_or(run.record.reading.downscale) != run.record.reading.downscale) return {};
    return kept;
  } catch (const Error& error) {
    warn(text(error.what(), "\n  the run will be evaluated again"));
    return {};
  }
}

std::vector<ComparedRun> read_runs(const CompareRequest& request, const Common& common) {
  std::vector<ComparedRun> runs;
  for (const std::string& run : request.runs) runs.push_back({run, read_record(run), {}});
  if (!request.features.empty() || !request.lpips.empty()) open_device(common);
  const Networks networks = networks_of(request);
  for (ComparedRun& one : runs) {
    if (const auto kept = kept_eval(request, one, networks)) {
      one.eval = *kept;
      continue;
    }
    say(common, "evaluating " + one.run);
    one.eval = measure_run(
        {.run = one.run, .protocol = request.protocol, .features = request.features, .lpips = request.lpips}, common);
  }
  return runs;
}

int digits_of(double value) { return std::abs(value) < 1 ? 4 : 2; }

std::string spelled(double value) { return fmt::format("{:.{}f}", value, digits_of(value)); }

/// Of the same data guesses do not depend on the seed: they have no deviation.
std::string spelled(const Mean& value) {
  const std::string mean = spelled(value.mean);
  return value.deviation == 0 ? mean : fmt::format("{} +- {:.{}f}", mean, value.deviation, digits_of(value.mean));
}

std::string steps_of(const RunGroup& group) {
  std::set<int64_t> steps;
  for (const ComparedRun* run : group) steps.insert(static_cast<int64_t>(figure(run->eval, "step").value_or(0)));
  return *steps.begin() == *steps.rbegin() ? text(*steps.begin()) : text(*steps.begin(), "-", *steps.rbegin());
}

std::vector<ComparedFigure> used_columns(const std::vector<ComparedRun>& runs) {
  std::vector<ComparedFigure> used;
  for (const ComparedFigure& column : kComparedFigures) {
    if (std::any_of(runs.begin(), runs.end(), [&](const ComparedRun& run) { return figure(run.eval, column.key); }))
      used.push_back(column);
  }
  return used;
}

Cells cells_of(const ComparedRun& run, const std::vector<ComparedFigure>& columns) {
  Cells cells = {run.run,          run.record.method,         run.record.preset, text(run.record.seed),
                 steps_of({&run}), word(run.eval, "protocol")};
  for (const ComparedFigure& column : columns) {
    const auto value = figure(run.eval, column.key);
    cells.push_back(value ? spelled(*value) : "-");
  }
  return cells;
}

Cells cells_of(const RunGroup& group, const std::vector<ComparedFigure>& columns) {
  Cells cells = cells_of(*group.front(), {});
  cells[0] = text("mean of ", group.size());
  cells[3] = "";
  cells[4] = steps_of(group);
  for (const ComparedFigure& column : columns) {
    const auto value = mean_of(group, column.key);
    cells.push_back(value ? spelled(*value) : "-");
  }
  return cells;
}

/// Words to the left, figures to the right.
std::string aligned(const std::vector<Cells>& rows) {
  constexpr std::size_t kWords = 3;
  std::vector<std::size_t> widths(rows.front().size());
  for (const Cells& row : rows)
    for (std::size_t i = 0; i < row.size(); ++i) widths[i] = std::max(widths[i], row[i].size());
  std::string out;
  for (const Cells& row : rows) {
    for (std::size_t i = 0; i < row.size(); ++i) {
      out += i == 0 ? "" : "  ";
      out += i < kWords ? fmt::format("{:<{}}", row[i], widths[i]) : fmt::format("{:>{}}", row[i], widths[i]);
    }
    out += "\n";
  }
  return out;
}

std::string table(const std::vector<ComparedRun>& runs, const std::vector<RunGroup>& groups) {
  const std::vector<ComparedFigure> columns = used_columns(runs);
  Cells head = {"run", "method", "preset", "seed", "steps", "protocol"};
  for (const ComparedFigure& column : columns) head.push_back(column.heading);
  std::vector<Cells> rows = {head}, means = {head};
  for (const ComparedRun& run : runs) rows.push_back(cells_of(run, columns));
  for (const RunGroup& group : groups) means.push_back(cells_of(group, columns));
  return aligned(rows) + (groups.empty() ? "" : "\n" + aligned(means));
}

void warn_of_differences(const std::vector<ComparedRun>& runs) {
  const std::pair<const char*, const char*> options[] = {
      {"protocol", "--protocol"}, {"feature_network", "--features"}, {"perceptual_network", "--lpips"}};
  for (const auto& [key, option] : options) {
    std::set<std::string> words;
    for (const ComparedRun& run : runs) words.insert(word(run.eval, key));
    if (words.size() > 1) warn(text("the runs were measured differently (", key, "): choose one with ", option));
  }
}

int run_compare(const CompareRequest& request, const Common& common) {
  const std::vector<ComparedRun> runs = read_runs(request, common);
  const std::vector<RunGroup> groups = groups_of(runs, request.across_data);
  warn_of_differences(runs);
  if (common.json)
    put_json(to_json(runs, groups), 2);
  else
    put(table(runs, groups));
  const std::string network = word(runs.front().eval, "feature_network");
  say(common, text("masked: actors only; the columns after the features are baselines to beat",
                   network.empty() ? "" : "; features: distances by " + network));
  return 0;
}

}  // namespace

Command add_compare(CLI::App& program) {
  return command<CompareRequest>(
      program, "compare", kCompareExamples, run_compare, [](const Options& add, CompareRequest& r) {
        add("RUN", r.runs, "Run folders").required();
        add("--protocol", r.protocol, "Compare sparse, novel or rotate360; runs without it are evaluated first",
            one_of(protocol_names()));
        add("--features", r.features, "Also compare feature distances; a file with network weights, or random");
        add("--lpips", r.lpips,
            "Also compare LPIPS; weights of AlexNet or VGG-16, a comma, those of the linear layers");
        add("--across-data", r.across_data, "Also average over runs on different data");
      });
}

}  // namespace cloam
