// cloam tables: the paper's tables by one command. It is a list of commands, each a program of its own, so that one
// that runs out of memory ends nothing but itself.
#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>

#include "cli/commands.h"
#include "cli/tables_run.h"
#include "models/eval/table_figures.h"
#include "models/io/words.h"
#include "models/methods/registry.h"
#include "models/metrics/lpips.h"
#include "models/nn/feature_network.h"
#include "runtime/error.h"

namespace cloam {
namespace {

using Names = std::vector<std::string>;

constexpr char kTablesExamples[] =
    R"(Train and measure all rows of the GenAssets paper's tables and show them beside the paper's.

Examples:
  cloam tables --size small -o tables                         on logs that it makes itself, in about two hours
  cloam tables --size small -o tables --methods nerf,splat    ... and with other methods
  cloam tables --size small -o tables --rows none --methods nerf,splat    those alone, beside the best guesses
  cloam tables --size small -o tables --measure logs/003 --rows shipped --methods neurad    trains no networks first
  cloam tables data/pandaset -o tables --dry-run              the paper's sizes: which commands, how many hours
  cloam tables --size small --train logs/001,logs/002 --measure logs/003 -o tables --seeds 1,2,3
  cloam tables --size small --measure logs/003 -o tables --jobs 2    trains on made logs, two commands at a time

It can be stopped at any time: the same command goes on where it was. Rows, methods, protocols and seeds may be added.
The result is tables.json, tables.md and a page with pictures, index.html.)";

struct TablesRequest {
  TableLogWish logs;
  std::string out, size = "paper", rows, methods, protocols, seeds = "1", features = "random", perceptual, lpips, steps;
  Names settings;
  int jobs = 1;
  bool dry_run = false;
};

[[noreturn]] void unknown(const char* option, const std::string& name, const Names& known) {
  throw Error(Fault::usage,
              text(option, ": unknown ", name, did_you_mean(name, known), "\n  want some of ", joined(known)));
}

/// The words of a list, each of which must be known; all of `otherwise` where none is given.
Names chosen(const char* option, const std::string& list, const Names& known, const Names& otherwise) {
  if (list.empty()) return otherwise;
  Names names;
  for (const std::string& name : comma_separated(list)) {
    if (std::find(known.begin(), known.end(), name) == known.end()) unknown(option, name, known);
    if (std::find(names.begin(), names.end(), name) == names.end()) names.push_back(name);
  }
  return names;
}

/// GenAssets' rows, then the other methods'.
std::vector<TableRow> rows_of(const TablesRequest& request, bool small) {
  Names known, usual;
  for (const TableRow& row : genassets_rows()) {
    if (row.small_alone && !small) continue;
    known.push_back(row.key);
    if (row.preset_ending.empty() && row.networks.empty()) usual.push_back(row.key);
  }
  std::vector<TableRow> rows;
  const Names wanted = request.rows == "none" ? Names() : chosen("--rows", request.rows, known, usual);
  for (const TableRow& row : genassets_rows())
    if (std::find(wanted.begin(), wanted.end(), row.key) != wanted.end()) rows.push_back(row);
  const Names methods = request.methods == "none"
                            ? Names()
                            : chosen("--methods", request.methods, table_methods(), small ? Names() : table_methods());
  for (const std::string& method : methods) rows.push_back(row_of_method(method));
  if (rows.empty())
    throw Error(Fault::usage,
                text("--rows none without --methods: nothing is measured, want a row of GenAssets or a method",
                     "\n  fix: --methods ", joined(table_methods(), ",")));
  return rows;
}

std::vector<int64_t> seeds_of(const std::string& list) {
  std::set<int64_t> seeds;
  for (const std::string& word : comma_separated(list)) {
    const auto seed = number_in<int64_t>(word);
    if (!seed || *seed < 0)
      throw Error(Fault::usage, text("--seeds ", list, ": want whole numbers of 0 or more, as in 1,2,3"));
    seeds.insert(*seed);
  }
  return {seeds.begin(), seeds.end()};
}

std::map<std::string, int64_t> steps_of(const std::string& list) {
  std::map<std::string, int64_t> steps;
  if (list.empty()) return steps;
  for (const std::string& word : comma_separated(list)) {
    const std::size_t equals = std::min(word.find('='), word.size());
    const std::string of = word.substr(0, equals);
    const auto count = number_in<int64_t>(word.substr(std::min(word.size(), equals + 1)));
    if (std::find(table_steps().begin(), table_steps().end(), of) == table_steps().end())
      unknown("--steps", of, table_steps());
    if (!count || *count < 1)
      throw Error(Fault::usage, text("--steps ", word, ": want a number, as in train=2000,fit=300"));
    steps[of] = *count;
  }
  return steps;
}

/// A file is named from the root of the disk, so that the list is the same wherever it is called.
std::string absolute_file(const std::string& file) {
  return file.empty() || file == "random" ? file : fs::absolute(file).lexically_normal().string();
}

/// Logs that this table made itself train, or are photographed: none of them can be measured.
void check_not_made_here(const std::vector<TableLog>& measured, const std::string& out) {
  const std::string made = (fs::weakly_canonical(out) / "logs" / "").string();
  for (const TableLog& log : measured)
    if (log.path.starts_with(made))
      throw Error(Fault::usage,
                  text(log.path, " was made by this table to train or to be photographed; measure another log"));
}

void check_stage1(const TablesRequest& request, const std::vector<TableRow>& rows) {
  const bool changes = !request.settings.empty() || !request.perceptual.empty();
  if (changes && std::none_of(rows.begin(), rows.end(), learns_networks))
    throw Error(
        Fault::usage,
        text(request.settings.empty() ? "--perceptual" : "--set",
             " changes trainings of stage 1, which none of these rows has\n  fix: leave it out, or --rows full"));
}

TablePlan plan_of(const TablesRequest& request) {
  TableRequest wish;
  wish.small = request.size == "small";
  const bool makes = wish.small && request.logs.root.empty() && request.logs.train.empty();
  if (makes) {
    wish.logs.measured = measured_table_logs(request.logs);
    check_not_made_here(wish.logs.measured, request.out);
  } else {
    wish.logs = find_table_logs(request.logs);
  }
  wish.rows = rows_of(request, wish.small);
  check_stage1(request, wish.rows);
  wish.protocols = table_protocols();
  const Names wanted = chosen("--protocols", request.protocols, table_protocols(), table_protocols());
  std::erase_if(wish.protocols,
                [&](const std::string& one) { return std::find(wanted.begin(), wanted.end(), one) == wanted.end(); });
  wish.seeds = seeds_of(request.seeds);
  features_named(request.features);  // a wrong file is told before hours of work
  wish.features = absolute_file(request.features);
  if (!request.perceptual.empty()) features_named(request.perceptual);
  wish.perceptual = absolute_file(request.perceptual);
  for (const std::string& file : comma_separated(request.lpips))
    wish.lpips += (wish.lpips.empty() ? "" : ",") + absolute_file(file);
  if (!wish.lpips.empty()) lpips_named(wish.lpips);
  wish.steps = steps_of(request.steps);
  wish.settings = request.settings;
  return table_plan(wish);
}

std::string hours(double seconds) { return fmt::format("{:.2f}", seconds / 3600); }

std::string what(const TableNode& node) {
  if (node.work == TableWork::logs) return "logs";
  if (node.work == TableWork::crops) return "photos";
  if (node.work == TableWork::measure) return node.log.empty() ? "sets" : "pictures";
  return "steps";
}

std::string list_of(const TablePlan& plan, const TableFolder& folder) {
  std::string out = fmt::format("{:<48} {:>10}          {:>10}\n", "command", "work", "hours");
  double all = 0;
  for (const TableNode& node : plan.nodes) {
    const bool done = is_done(folder, node);
    out += fmt::format("{:<48} {:>10} {:<8} {:>10}\n", node.id, node.steps, what(node),
                       done ? "done" : hours(node.seconds));
    all += node.seconds;
  }
  const double left = seconds_left(folder, plan);
  out += fmt::format("{} commands, {} hours on two cores", plan.nodes.size(), hours(all));
  return out + (left == all ? "\n" : fmt::format("; {} hours left, by what was timed here\n", hours(left)));
}

nlohmann::ordered_json json_of(const TablePlan& plan, const TableFolder& folder) {
  nlohmann::ordered_json json = {{"schema_version", 1}, {"commands", nlohmann::ordered_json::array()}};
  double all = 0;
  for (const TableNode& node : plan.nodes) {
    Names words;
    for (const std::string& word : node.words) words.push_back(folder.word(word));
    json["commands"].push_back({{"id", node.id},
                                {"command", typed(words)},
                                {"needs", node.needs},
                                {what(node), node.steps},
                                {"hours", node.seconds / 3600},
                                {"done", is_done(folder, node)}});
    all += node.seconds;
  }
  json["hours"] = all / 3600;
  json["hours_left"] = seconds_left(folder, plan) / 3600;
  return json;
}

int run_tables_command(const TablesRequest& request, const Common& common) {
  const TableFolder folder{request.out};
  const TablePlan plan = plan_of(request);
  check_same_table(folder, plan);
  if (!request.dry_run) return run_tables(folder, plan, request.jobs, common);
  common.json ? put_json(json_of(plan, folder), 2) : put(list_of(plan, folder));
  say(common, "dry run: nothing was written");
  return 0;
}

}  // namespace

Command add_tables(CLI::App& program) {
  return command<TablesRequest>(
      program, "tables", kTablesExamples, run_tables_command, [](const Options& add, TablesRequest& r) {
        add("LOGS_ROOT", r.logs.root, "Folder of driving logs: PandaSet's 001, 002, ...");
        add("-o,--out", r.out, "Folder for runs, figures and page; one that a table was begun in is continued",
            output_folder())
            .required();
        add("--size", r.size, "paper (the default), or small: minutes a run; without logs it makes some",
            one_of({"paper", "small"}));
        add("--train", r.logs.train,
            "Logs to train on, a list (default: all in LOGS_ROOT that are not measured; small without it: made ones)");
        add("--measure", r.logs.measure, "Logs to measure, a list (" + joined(paper_logs(), ",") + ")");
        Names rows;
        for (const TableRow& row : genassets_rows()) rows.push_back(row.key);
        add("--rows", r.rows, "Rows of GenAssets, a list of " + joined(rows) + " (all but the last three), or none");
        add("--methods", r.methods, "Other methods, a list of " + joined(table_methods()) + ", or none (small: none)");
        add("--protocols", r.protocols, "List of " + joined(table_protocols()) + " (all)");
        add("--seeds", r.seeds, "List of random seeds (1)");
        add("--steps", r.steps, "List such as train=2000,fit=300; also assets=N and methods=N");
        add("--features", r.features, "To measure by: weights of a feature network, or random (the default)");
        add("--lpips", r.lpips,
            "Also measure LPIPS: weights of AlexNet or VGG-16, a comma, those of the linear layers");
        add("--perceptual", r.perceptual, "To train by: weights for the perceptual loss (default: random features)");
        add("--set", r.settings, "Setting key=value for the trainings of stage 1; may be repeated").one_word();
        add("--jobs", r.jobs, "Commands to run side by side (1); each gets its share of cores and memory",
            whole_number(1, 64));
        add("--dry-run", r.dry_run, "List the commands with their hours; write nothing");
      });
}

}  // namespace cloam
