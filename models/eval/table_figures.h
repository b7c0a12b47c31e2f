// The figures of the paper's tables: means over measured logs and seeds of what evaluations found, beside the best
// guess that knows nothing and what the paper found.
#pragma once
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "models/eval/table_plan.h"

namespace cloam {

/// How a row differs from the table's first, paired by measured log and seed.
struct TableDifference {
  double mean = 0;                    // the row's figures minus the first's: over seeds, of means over logs
  std::optional<double> spread;       // standard deviation of the seeds' means (n - 1)
  std::size_t pairs = 0, better = 0;  // pairs of evaluations; those in which the row is the better one
};

struct TableCell {
  double mean = 0;                         // over seeds, of means over logs
  std::optional<double> spread;            // standard deviation of the seeds' means (n - 1)
  std::optional<double> spread_of_logs;    // the same of the logs' means over seeds
  std::vector<int64_t> seeds;              // that have the figure
  std::size_t measured = 0, expected = 0;  // evaluations
  std::optional<double> guess, paper;
  std::string guess_key;
  /// Nothing without a guess.
  std::optional<bool> beats_guess;
  /// Nothing in the first row, and where no pair was measured.
  std::optional<TableDifference> from_first;
};

/// One protocol's: a line for each row, a cell for each column; nothing where nothing was found.
struct ProtocolTable {
  struct Line {
    TableRow row;
    std::vector<std::optional<TableCell>> cells;
  };
  std::string protocol;
  std::vector<TableColumn> columns;  // those that a line has
  std::vector<Line> lines;           // those that the list measures
};

struct TableFigures {
  std::vector<ProtocolTable> tables;
  std::vector<std::string> networks;  // feature networks that measured
  std::vector<std::string> missing;   // ids of measurements that found nothing
};

/// What an evaluation found (eval.json); nothing: it was not made.
using FiguresOf = std::function<std::optional<nlohmann::ordered_json>(const TableNode&)>;

TableFigures table_figures(const TablePlan& plan, const FiguresOf& figures_of);

/// "19.53", "19.53 +- 0.20" over seeds.
std::string spelled(const TableCell& cell, const TableColumn& column);
std::string spelled(double value, const TableColumn& column);
/// "-0.81 +- 0.10 (better in 1 of 12)".
std::string spelled(const TableDifference& difference, const TableColumn& column);

/// tables.json and tables.md. They hold no time, path or device: equal runs give equal bytes.
nlohmann::ordered_json to_json(const TableFigures& figures, const TablePlan& plan);
std::string to_markdown(const TableFigures& figures, const TablePlan& plan);

}  // namespace cloam
