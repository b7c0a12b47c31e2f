// What stands in the paper's tables: their rows, the figures of each protocol, and what the paper found (GenAssets,
// supplement, Tables A2 and A3). Data alone: table_plan.h makes runs of it, table_figures.h fills it in.
#pragma once
#include <string>
#include <vector>

namespace cloam {

/// A figure of the paper's, by the key that eval.json has for it.
struct PaperFigure {
  const char *protocol, *key;
  double value;
};

struct TableRow {
  std::string key, title, method;
  std::string preset_ending = {};          // behind the name of the size's preset
  std::vector<std::string> settings = {};  // key=value, over the preset
  bool generates = false;                  // has codes and stands in Table A3
  bool small_alone = false;  // at the paper's sizes it would be another row's equal, or its networks do not fit
  std::vector<PaperFigure> paper = {};
  std::string networks = {};  // those that `train --networks` takes; empty: stage 1 learns its own
};

/// A figure of one protocol. key and guesses are those of eval.json (docs/formats.md); what eval does not find there
/// has no column.
struct TableColumn {
  const char *protocol, *key, *title;
  bool higher_is_better;
  int digits;
  std::vector<const char*> guesses;  // what knows nothing; the best of them is what counts
};

/// "generation": what is measured beside the protocols of driving logs.
constexpr char kGeneration[] = "generation";

/// In the order of the tables: sparse, novel, rotate360, generation.
const std::vector<std::string>& table_protocols();
/// "sparse view", as the paper calls it.
std::string protocol_title(const std::string& protocol);

/// The rows of GenAssets.
const std::vector<TableRow>& genassets_rows();
/// Methods that can stand in a table: they learn from captures, render views and share no networks.
std::vector<std::string> table_methods();
TableRow row_of_method(const std::string& method);
/// Whether stage 1 comes first: networks that all logs share.
bool learns_networks(const TableRow& row);

const std::vector<TableColumn>& table_columns();

}  // namespace cloam
