// See table_state.h.
#include "models/eval/table_state.h"

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>

#include "models/io/commit.h"
#include "models/io/json.h"
#include "models/io/words.h"
#include "models/runs/run_folder.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;
using Words = std::vector<std::string>;

bool is_finished_run(const fs::path& folder) {
  try {
    return is_run(folder) && read_record(folder).state == "finished";
  } catch (const Error&) { return false; }
}

bool made_all(const TableFolder& folder, const TableNode& node) {
  if (node.work == TableWork::measure) return read_figures(folder, node).has_value();
  std::error_code error;
  if (node.work == TableWork::crops) return fs::exists(folder.of(node) / "crops.json", error);
  return node.work == TableWork::logs ? fs::is_directory(folder.of(node), error) : is_finished_run(folder.of(node));
}

/// The first words in which they differ, for people.
std::string difference(const Words& before, const Words& now) {
  const std::size_t shared = std::min(before.size(), now.size());
  std::size_t at = 0;
  while (at < shared && before[at] == now[at]) ++at;
  const auto rest = [&](const Words& words) {
    const Words shown(words.begin() + static_cast<std::ptrdiff_t>(at > 0 ? at - 1 : at),
                      words.begin() + static_cast<std::ptrdiff_t>(std::min(words.size(), at + 2)));
    return joined(shown, " ");
  };
  return text("\n  before: ... ", rest(before), " ...\n  now:    ... ", rest(now), " ...");
}

/// An empty folder, or one that a table began.
void check_own(const TableFolder& folder) {
  std::error_code error;
  if (fs::is_directory(folder.root / "nodes", error)) return;
  for (fs::directory_iterator entry(folder.root, error), end; !error && entry != end; entry.increment(error))
    if (entry->path().filename() != ".lock")
      throw Error(Fault::usage,
                  text(folder.root.string(), " exists and holds no table (no nodes/); name another folder with -o"));
}

}  // namespace

std::string TableFolder::word(const std::string& word) const {
  return word.starts_with("@/") ? (root / word.substr(2)).string() : word;
}

std::optional<NodeRecord> read_node(const TableFolder& folder, const TableNode& node) {
  const fs::path path = folder.record(node);
  std::error_code error;
  if (!fs::exists(path, error)) return {};
  const Json json = parse_json_file(path);
  NodeRecord record;
  record.state = string(json, "state", path.string());
  record.seconds = optional_number(json, "seconds", path.string());
  record.error = optional_string(json, "error", path.string()).value_or("");
  for (const Json& word : array(json, "words", path.string())) {
    if (!word.is_string()) throw Error(Fault::data, text(path.string(), ": \"words\" holds something else"));
    record.words.push_back(word.get<std::string>());
  }
  return record;
}

void write_node(const TableFolder& folder, const TableNode& node, const NodeRecord& record) {
  nlohmann::ordered_json json = {{"schema_version", 1}, {"state", record.state}, {"words", record.words}};
  if (record.seconds) json["seconds"] = *record.seconds;
  if (!record.error.empty()) json["error"] = record.error;
  commit_text(folder.record(node), json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n");
}

bool is_done(const TableFolder& folder, const TableNode& node) {
  const auto record = read_node(folder, node);
  return record && record->state == "done" && record->words == node.words && made_all(folder, node);
}

std::optional<nlohmann::ordered_json> read_figures(const TableFolder& folder, const TableNode& node) {
  std::error_code error;
  if (!fs::exists(folder.figures(node), error)) return {};
  try {
    return nlohmann::ordered_json(parse_json_file(folder.figures(node)));
  } catch (const Error&) { return {}; }
}

void check_same_table(const TableFolder& folder, const TablePlan& plan) {
  check_own(folder);
  for (const TableNode& node : plan.nodes) {
    const auto record = read_node(folder, node);
    if (!record || record->words == node.words) continue;
    throw Error(
        Fault::usage,
        text(folder.root.string(), " was begun with other options: ", node.id, " differs",
             difference(record->words, node.words),
             "\n  fix: the options of before (rows, seeds, methods and protocols may be added), or another -o"));
  }
}

double seconds_left(const TableFolder& folder, const TablePlan& plan) {
  std::map<TableWork, std::pair<double, double>> timed;  // expected and measured
  std::pair<double, double> all;
  std::vector<const TableNode*> ahead;
  for (const TableNode& node : plan.nodes) {
    const auto record = read_node(folder, node);
    if (!record || record->state != "done") {
      ahead.push_back(&node);
      continue;
    }
    if (!record->seconds) continue;
    for (auto* sums : {&timed[node.work], &all}) sums->first += node.seconds, sums->second += *record->seconds;
  }
  const auto ratio = [](const std::pair<double, double>& sums) { return sums.second / sums.first; };
  double left = 0;
  for (const TableNode* node : ahead) {
    const auto own = timed.find(node->work);
    left += node->seconds * (own != timed.end() ? ratio(own->second) : all.first > 0 ? ratio(all) : 1);
  }
  return left;
}

}  // namespace cloam
