// cloam compare: the evaluations of runs side by side, and the means of those that differ by their seeds alone.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>

#include "cli/commands.h"
#include "cli/eval.h"
#include "models/io/json.h"
#include "models/runs/run_folder.h"
#include "models/scene/split.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;
using Report = nlohmann::ordered_json;
using Cells = std::vector<std::string>;

constexpr char kExamples[] = R"(Show the evaluations of runs side by side; runs without one are evaluated first.

Examples:
  cloam compare runs/a runs/b
  cloam compare runs/*-seed? --protocol rotate360 --features squeezenet.npz
  cloam compare runs/nerf-* runs/splat-* --across-data
  cloam compare runs/a runs/b --json

Runs with the same data and settings but different seeds are also averaged (mean and standard deviation).)";

struct CompareRequest {
  std::vector<std::string> runs;
  std::string protocol, features;  // as eval takes them; empty: what RUN/eval holds
  bool across_data = false;        // averages runs of different data, too
};

struct Column {
  const char *key, *heading;
};

// Keys of eval.json (docs/formats.md). The table leaves out what no run has.
const Column kColumns[] = {{"psnr", "PSNR"},
                           {"ssim", "SSIM"},
                           {"masked_psnr", "masked PSNR"},
                           {"masked_ssim", "masked SSIM"},
                           {"lidar_median_error_m", "LiDAR m"},
                           {"feature_distance", "features"},
                           {"masked_feature_distance", "masked features"},
                           {"frechet_feature_distance", "Frechet features"},
                           {"kernel_feature_distance", "kernel features"},
                           {"fid", "FID"},
                           {"kid", "KID"},
                           {"baseline_mean_colour_psnr", "mean colour"},
                           {"baseline_nearest_frame_psnr", "nearest"},
                           {"baseline_blend_psnr", "blend"},
                           {"baseline_blend_masked_psnr", "masked blend"},
                           {"baseline_mean_masked_psnr", "masked mean"}};

struct Compared {
  std::string run;
  RunRecord record;
  Report eval;
};
using Group = std::vector<const Compared*>;  // runs that are averaged

/// What RUN/eval holds, if it is what was asked for and the run has not gone on since.
std::optional<Report> kept_eval(const CompareRequest& request, const RunPaths& run, int64_t step,
                                const std::string& network) {
  const fs::path path = run.eval() / "eval.json";
  if (!fs::exists(path)) return {};
  try {
    const Json json = parse_json_file(path);
    const std::string protocol = string(json, "protocol", path.string());
    const bool asked = request.protocol.empty() || request.protocol == protocol;
    const bool same_network = network.empty() || optional_string(json, "feature_network", path.string()) == network;
    if (!asked || !same_network || number(json, "step", path.string()) < static_cast<double>(step)) return {};
    return Report(json);
  } catch (const Error& error) {
    warn(text(error.what(), "\n  the run will be evaluated again"));
    return {};
  }
}

std::vector<Compared> read_runs(const CompareRequest& request, const Common& common) {
  std::vector<Compared> runs;
  for (const std::string& run : request.runs) runs.push_back({run, read_record(run), {}});
  std::string network;
  if (!request.features.empty()) {
    open_device(common);
    network = features_named(request.features).name;
  }
  for (Compared& one : runs) {
    if (const auto kept = kept_eval(request, RunPaths{one.run}, one.record.step, network)) {
      one.eval = *kept;
      continue;
    }
    say(common, "evaluating " + one.run);
    EvalRequest eval;
    eval.run = one.run;
    eval.protocol = request.protocol;
    eval.features = request.features;
    one.eval = measure_run(eval, common);
  }
  return runs;
}

std::string word(const Report& eval, const char* key) {
  const auto at = eval.find(key);
  return at == eval.end() || !at->is_string() ? "" : at->get<std::string>();
}

std::optional<double> figure(const Report& eval, const char* key) {
  const auto at = eval.find(key);
  if (at == eval.end() || !at->is_number()) return {};
  return at->get<double>();
}

bool same_reading(const Reading& a, const Reading& b) {
  return a.downscale == b.downscale && a.holdout == b.holdout && a.protocol.name == b.protocol.name &&
         a.protocol.sparse_every == b.protocol.sparse_every && a.image == b.image && a.masks == b.masks;
}

bool same_data(const RunRecord& a, const RunRecord& b) {
  const auto same = [](const RunData& x, const RunData& y) { return x.fingerprint == y.fingerprint; };
  return std::equal(a.data.begin(), a.data.end(), b.data.begin(), b.data.end(), same);
}

/// What neither seeds nor data differ in.
bool same_method(const Compared& a, const Compared& b) {
  const RunRecord &r = a.record, &s = b.record;
  return r.method == s.method && r.preset == s.preset && r.settings == s.settings && r.steps == s.steps &&
         same_reading(r.reading, s.reading) && word(a.eval, "protocol") == word(b.eval, "protocol") &&
         word(a.eval, "feature_network") == word(b.eval, "feature_network");
}

std::vector<Group> groups_of(const std::vector<Compared>& runs, bool across_data) {
  std::vector<Group> groups;
  for (const Compared& run : runs) {
    const auto fits = [&](const Group& group) {
      const Compared& first = *group.front();
      return same_method(first, run) && (across_data || same_data(first.record, run.record));
    };
    const auto group = std::find_if(groups.begin(), groups.end(), fits);
    group == groups.end() ? groups.push_back({&run}) : group->push_back(&run);
  }
  std::erase_if(groups, [](const Group& group) { return group.size() < 2; });
  return groups;
}

struct Mean {
  double mean, deviation;  // of a sample: divided by n - 1
};

/// Nothing unless every run has the figure.
std::optional<Mean> mean_of(const Group& group, const char* key) {
  double sum = 0, squares = 0;
  for (const Compared* run : group) {
    const auto value = figure(run->eval, key);
    if (!value) return {};
    sum += *value;
  }
  const double count = static_cast<double>(group.size()), mean = sum / count;
  for (const Compared* run : group) squares += std::pow(*figure(run->eval, key) - mean, 2);
  return Mean{mean, std::sqrt(squares / (count - 1))};
}

int digits_of(double value) { return std::abs(value) < 1 ? 4 : 2; }

std::string spelled(double value) { return fmt::format("{:.{}f}", value, digits_of(value)); }

/// Of the same data guesses do not depend on the seed: they have no deviation.
std::string spelled(const Mean& value) {
  const std::string mean = spelled(value.mean);
  return value.deviation == 0 ? mean : fmt::format("{} +- {:.{}f}", mean, value.deviation, digits_of(value.mean));
}

std::string steps_of(const Group& group) {
  std::set<int64_t> steps;
  for (const Compared* run : group) steps.insert(static_cast<int64_t>(figure(run->eval, "step").value_or(0)));
  return *steps.begin() == *steps.rbegin() ? text(*steps.begin()) : text(*steps.begin(), "-", *steps.rbegin());
}

std::vector<Column> used_columns(const std::vector<Compared>& runs) {
  std::vector<Column> used;
  for (const Column& column : kColumns) {
    if (std::any_of(runs.begin(), runs.end(), [&](const Compared& run) { return figure(run.eval, column.key); }))
      used.push_back(column);
  }
  return used;
}

Cells row_of(const Compared& run, const std::vector<Column>& columns) {
  Cells cells = {run.run,          run.record.method,         run.record.preset, text(run.record.seed),
                 steps_of({&run}), word(run.eval, "protocol")};
  for (const Column& column : columns) {
    const auto value = figure(run.eval, column.key);
    cells.push_back(value ? spelled(*value) : "-");
  }
  return cells;
}

Cells row_of(const Group& group, const std::vector<Column>& columns) {
  Cells cells = row_of(*group.front(), {});
  cells[0] = text("mean of ", group.size());
  cells[3] = "";
  cells[4] = steps_of(group);
  for (const Column& column : columns) {
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

std::string table(const std::vector<Compared>& runs, const std::vector<Group>& groups) {
  const std::vector<Column> columns = used_columns(runs);
  Cells head = {"run", "method", "preset", "seed", "steps", "protocol"};
  for (const Column& column : columns) head.push_back(column.heading);
  std::vector<Cells> rows = {head}, means = {head};
  for (const Compared& run : runs) rows.push_back(row_of(run, columns));
  for (const Group& group : groups) means.push_back(row_of(group, columns));
  return aligned(rows) + (groups.empty() ? "" : "\n" + aligned(means));
}

Report report(const std::vector<Compared>& runs, const std::vector<Group>& groups) {
  Report json = {{"schema_version", 1}, {"runs", Report::array()}, {"means", Report::array()}};
  const auto head = [](const Compared& run) {
    Report row = {{"method", run.record.method}, {"preset", run.record.preset}, {"protocol", run.eval["protocol"]}};
    if (run.eval.contains("feature_network")) row["feature_network"] = run.eval["feature_network"];
    return row;
  };
  for (const Compared& run : runs) {
    Report row = {{"run", run.run}, {"seed", run.record.seed}, {"steps", run.eval["step"]}};
    row.update(head(run));
    for (const Column& column : kColumns)
      if (run.eval.contains(column.key)) row[column.key] = run.eval[column.key];
    json["runs"].push_back(row);
  }
  for (const Group& group : groups) {
    Report row = head(*group.front());
    for (const Compared* run : group) row["seeds"].push_back(run->record.seed);
    for (const Column& column : kColumns)
      if (const auto value = mean_of(group, column.key))
        row[column.key] = {{"mean", value->mean}, {"deviation", value->deviation}};
    json["means"].push_back(row);
  }
  return json;
}

void warn_of_differences(const std::vector<Compared>& runs) {
  for (const char* key : {"protocol", "feature_network"}) {
    std::set<std::string> words;
    for (const Compared& run : runs) words.insert(word(run.eval, key));
    if (words.size() > 1)
      warn(text("the runs were measured differently (", key, "): choose one with ",
                key[0] == 'p' ? "--protocol" : "--features"));
  }
}

int run_command(const CompareRequest& request, const Common& common) {
  const std::vector<Compared> runs = read_runs(request, common);
  const std::vector<Group> groups = groups_of(runs, request.across_data);
  warn_of_differences(runs);
  if (common.json)
    put_json(report(runs, groups), 2);
  else
    put(table(runs, groups));
  const std::string network = word(runs.front().eval, "feature_network");
  say(common, text("masked: actors only; the columns after the features are baselines to beat",
                   network.empty() ? "" : "; features: distances by " + network));
  return 0;
}

}  // namespace

Command add_compare(CLI::App& program) {
  return command<CompareRequest>(program, "compare", kExamples, run_command, [](const Options& add, CompareRequest& r) {
    add("RUN", r.runs, "Run folders")->required();
    add("--protocol", r.protocol, "Compare sparse, novel or rotate360; runs without it are evaluated first",
        one_of(protocol_names()));
    add("--features", r.features, "Also compare feature distances; a file with network weights, or random");
    add("--across-data", r.across_data, "Also average over runs on different data");
  });
}

}  // namespace cloam
