// How far a table's list of runs has come: a small file for each node beside what it made. A kill at any moment leaves
// records that are true.
#pragma once
#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "models/eval/table_plan.h"

namespace cloam {

struct NodeRecord {
  std::string state = "running";  // running (or killed) | done | failed
  std::vector<std::string> words;
  std::optional<double> seconds;  // of a command that ran in one go, over how many ran side by side
  std::string error = {};
};

/// Where a table's files lie.
struct TableFolder {
  std::filesystem::path root;
  std::filesystem::path of(const TableNode& node) const { return root / node.id; }
  std::filesystem::path record(const TableNode& node) const { return root / "nodes" / (node.id + ".json"); }
  std::filesystem::path figures(const TableNode& node) const { return of(node) / "eval.json"; }
  std::filesystem::path json() const { return root / "tables.json"; }
  std::filesystem::path markdown() const { return root / "tables.md"; }
  std::filesystem::path page() const { return root / "index.html"; }
  std::filesystem::path pictures() const { return root / "pictures"; }
  /// The word as a command takes it: "@/" is the folder.
  std::string word(const std::string& word) const;
};

/// Nothing if the node was never begun. Fault::data for a record that is damaged.
std::optional<NodeRecord> read_node(const TableFolder& folder, const TableNode& node);
void write_node(const TableFolder& folder, const TableNode& node, const NodeRecord& record);

/// Its record says so, of the same words, and what it made is there: a run that is finished, figures that can be read.
bool is_done(const TableFolder& folder, const TableNode& node);

/// What a measurement found; nothing if it is not there or no JSON.
std::optional<nlohmann::ordered_json> read_figures(const TableFolder& folder, const TableNode& node);

/// Refuses a folder that holds something else, and a list whose commands differ from those that were begun in it
/// before: Fault::usage that says in what. More rows, seeds, methods and protocols are welcome.
void check_same_table(const TableFolder& folder, const TablePlan& plan);

/// Expected seconds of the nodes that are not done, by how long those took that were timed.
double seconds_left(const TableFolder& folder, const TablePlan& plan);

}  // namespace cloam
