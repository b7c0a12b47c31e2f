// See table_figures.h.
#include "models/eval/table_figures.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "models/eval/compared_runs.h"
#include "models/io/words.h"
#include "runtime/error.h"

namespace cloam {
namespace {

using Report = nlohmann::ordered_json;

struct Measured {
  int64_t seed;
  std::string log;
  Report eval;
};
using Evaluations = std::vector<Measured>;  // of one row and protocol

/// "without_0.masked_psnr" is a key of an object within.
std::optional<double> figure_at(const Report& eval, const std::string& key) {
  const std::size_t dot = key.find('.');
  if (dot == std::string::npos) return figure(eval, key.c_str());
  const auto within = eval.find(key.substr(0, dot));
  return within == eval.end() || !within->is_object() ? std::nullopt : figure_at(*within, key.substr(dot + 1));
}

double mean(const std::vector<double>& values) {
  double sum = 0;
  for (const double value : values) sum += value;
  return sum / static_cast<double>(values.size());
}

/// Of a sample; nothing for a single value.
std::optional<double> deviation(const std::vector<double>& values) {
  if (values.size() < 2) return {};
  double squares = 0;
  for (const double value : values) squares += std::pow(value - mean(values), 2);
  return std::sqrt(squares / static_cast<double>(values.size() - 1));
}

/// The mean of each group, in the groups' order.
template <class Key>
std::vector<double> means_of(const std::map<Key, std::vector<double>>& groups) {
  std::vector<double> means;
  for (const auto& [key, values] : groups) means.push_back(mean(values));
  return means;
}

std::optional<double> mean_over_seeds(const Evaluations& evaluations, const char* key) {
  std::map<int64_t, std::vector<double>> by_seed;
  for (const Measured& one : evaluations)
    if (const auto value = figure_at(one.eval, key)) by_seed[one.seed].push_back(*value);
  return by_seed.empty() ? std::nullopt : std::optional(mean(means_of(by_seed)));
}

void add_guess(TableCell& cell, const Evaluations& evaluations, const TableColumn& column) {
  const auto better = [&](double a, double b) { return column.higher_is_better ? a > b : a < b; };
  for (const char* key : column.guesses) {
    const auto value = mean_over_seeds(evaluations, key);
    if (!value || (cell.guess && !better(*value, *cell.guess))) continue;
    cell.guess = value;
    cell.guess_key = key;
  }
  if (cell.guess) cell.beats_guess = better(cell.mean, *cell.guess);
}

std::optional<TableCell> cell_of(const Evaluations& evaluations, const TableRow& row, const TableColumn& column,
                                 std::size_t expected) {
  std::map<int64_t, std::vector<double>> by_seed;
  std::map<std::string, std::vector<double>> by_log;
  TableCell cell;
  for (const Measured& one : evaluations) {
    const auto value = figure_at(one.eval, column.key);
    if (!value) continue;
    by_seed[one.seed].push_back(*value);
    by_log[one.log].push_back(*value);
    ++cell.measured;
  }
  if (by_seed.empty()) return {};
  cell.expected = expected;
  cell.mean = mean(means_of(by_seed));
  cell.spread = deviation(means_of(by_seed));
  cell.spread_of_logs = deviation(means_of(by_log));
  for (const auto& [seed, values] : by_seed) cell.seeds.push_back(seed);
  for (const PaperFigure& paper : row.paper)
    if (std::string(paper.protocol) == column.protocol && std::string(paper.key) == column.key)
      cell.paper = paper.value;
  add_guess(cell, evaluations, column);
  return cell;
}

std::optional<TableDifference> difference_of(const Evaluations& evaluations, const Evaluations& first,
                                             const TableColumn& column) {
  std::map<int64_t, std::vector<double>> by_seed;
  TableDifference difference;
  for (const Measured& one : evaluations)
    for (const Measured& other : first) {
      if (one.seed != other.seed || one.log != other.log) continue;
      const auto value = figure_at(one.eval, column.key), beside = figure_at(other.eval, column.key);
      if (!value || !beside) continue;
      by_seed[one.seed].push_back(*value - *beside);
      ++difference.pairs;
      difference.better += column.higher_is_better ? *value > *beside : *value < *beside;
    }
  if (by_seed.empty()) return {};
  difference.mean = mean(means_of(by_seed));
  difference.spread = deviation(means_of(by_seed));
  return difference;
}

/// Columns that no line has are left out.
void drop_empty_columns(ProtocolTable& table) {
  for (std::size_t i = table.columns.size(); i-- > 0;) {
    const auto has = [&](const ProtocolTable::Line& line) { return line.cells[i].has_value(); };
    if (std::any_of(table.lines.begin(), table.lines.end(), has)) continue;
    table.columns.erase(table.columns.begin() + static_cast<std::ptrdiff_t>(i));
    for (ProtocolTable::Line& line : table.lines) line.cells.erase(line.cells.begin() + static_cast<std::ptrdiff_t>(i));
  }
}

void note_missing(TableFigures& figures, const TablePlan& plan, const FiguresOf& figures_of) {
  for (const TableNode& node : plan.nodes) {
    if (node.work != TableWork::measure) continue;
    const auto eval = figures_of(node);
    if (!eval) {
      figures.missing.push_back(node.id);
      continue;
    }
    const std::string network = word(*eval, "feature_network");
    auto& all = figures.networks;
    if (!network.empty() && std::find(all.begin(), all.end(), network) == all.end()) all.push_back(network);
  }
}

ProtocolTable table_of(const TablePlan& plan, const std::string& protocol, const FiguresOf& figures_of) {
  ProtocolTable table{protocol, {}, {}};
  for (const TableColumn& column : table_columns())
    if (protocol == column.protocol) table.columns.push_back(column);
  Evaluations first;
  for (const TableRow& row : plan.request.rows) {
    Evaluations evaluations;
    std::size_t expected = 0;
    for (const TableNode& node : plan.nodes) {
      if (node.work != TableWork::measure || node.row != row.key || node.protocol != protocol) continue;
      ++expected;
      if (const auto eval = figures_of(node)) evaluations.push_back({node.seed, node.log, *eval});
    }
    if (expected == 0) continue;
    ProtocolTable::Line line{row, {}};
    for (const TableColumn& column : table.columns) {
      std::optional<TableCell>& cell = line.cells.emplace_back(cell_of(evaluations, row, column, expected));
      if (cell && !table.lines.empty()) cell->from_first = difference_of(evaluations, first, column);
    }
    if (table.lines.empty()) first = evaluations;
    table.lines.push_back(line);
  }
  drop_empty_columns(table);
  return table;
}

Report number_or_null(const std::optional<double>& value) { return value ? Report(*value) : Report(nullptr); }

Report to_json(const TableCell& cell, const TableColumn& column) {
  Report json = {{"key", column.key}, {"mean", cell.mean}};
  json["spread"] = number_or_null(cell.spread);
  json["spread_of_logs"] = number_or_null(cell.spread_of_logs);
  json["seeds"] = cell.seeds;
  json["measured"] = cell.measured;
  json["expected"] = cell.expected;
  json["guess"] = number_or_null(cell.guess);
  json["guess_key"] = cell.guess_key.empty() ? Report(nullptr) : Report(cell.guess_key);
  json["beats_guess"] = cell.beats_guess ? Report(*cell.beats_guess) : Report(nullptr);
  json["paper"] = number_or_null(cell.paper);
  json["from_first"] = nullptr;
  if (const auto& difference = cell.from_first)
    json["from_first"] = {{"mean", difference->mean},
                          {"spread", number_or_null(difference->spread)},
                          {"pairs", difference->pairs},
                          {"better", difference->better}};
  return json;
}

Report to_json(const ProtocolTable& table) {
  Report json = {{"protocol", table.protocol}, {"title", protocol_title(table.protocol)}};
  json["columns"] = Report::array();
  for (const TableColumn& column : table.columns)
    json["columns"].push_back(
        {{"key", column.key}, {"title", column.title}, {"better", column.higher_is_better ? "higher" : "lower"}});
  json["rows"] = Report::array();
  for (const ProtocolTable::Line& line : table.lines) {
    Report row = {{"row", line.row.key}, {"title", line.row.title}, {"method", line.row.method}};
    row["cells"] = Report::array();
    for (std::size_t i = 0; i < line.cells.size(); ++i)
      if (line.cells[i]) row["cells"].push_back(to_json(*line.cells[i], table.columns[i]));
    json["rows"].push_back(row);
  }
  return json;
}

/// Which of the columns guess and paper a figure has anywhere.
bool any_cell(const ProtocolTable& table, std::size_t column, std::optional<double> TableCell::*member) {
  return std::any_of(table.lines.begin(), table.lines.end(), [&](const ProtocolTable::Line& line) {
    return line.cells[column] && ((*line.cells[column]).*member).has_value();
  });
}

std::string markdown_row(const std::vector<std::string>& cells) { return "| " + joined(cells, " | ") + " |\n"; }

std::string in_markdown(const std::optional<TableCell>& cell, const TableColumn& column) {
  if (!cell) return "-";
  std::string words = spelled(*cell, column);
  if (cell->beats_guess && !*cell->beats_guess) words += " (no better than the guess)";
  if (cell->measured < cell->expected) words += text(" (", cell->measured, " of ", cell->expected, " measured)");
  return words;
}

/// Rows minus the first, paired; nothing where the first row is alone.
std::string differences_in_markdown(const ProtocolTable& table) {
  const auto differs = [&](const ProtocolTable::Line& line) {
    return std::any_of(line.cells.begin(), line.cells.end(),
                       [](const std::optional<TableCell>& cell) { return cell && cell->from_first; });
  };
  if (std::none_of(table.lines.begin(), table.lines.end(), differs)) return "";
  std::vector<std::string> head = {"minus " + table.lines.front().row.title}, rule = {"---"};
  for (const TableColumn& column : table.columns) {
    head.emplace_back(column.title);
    rule.emplace_back("---:");
  }
  std::string out = markdown_row(head) + markdown_row(rule);
  for (const ProtocolTable::Line& line : table.lines) {
    if (!differs(line)) continue;
    std::vector<std::string> row = {line.row.title};
    for (std::size_t i = 0; i < line.cells.size(); ++i)
      row.push_back(line.cells[i] && line.cells[i]->from_first ? spelled(*line.cells[i]->from_first, table.columns[i])
                                                               : "-");
    out += markdown_row(row);
  }
  return out + "\n";
}

std::string to_markdown(const ProtocolTable& table) {
  std::vector<std::string> head = {"row"}, rule = {"---"};
  std::vector<std::vector<std::string>> rows;
  for (const ProtocolTable::Line& line : table.lines) rows.push_back({line.row.title});
  for (std::size_t i = 0; i < table.columns.size(); ++i) {
    const TableColumn& column = table.columns[i];
    const auto add = [&](const std::string& title, const auto& words_of) {
      head.push_back(title);
      rule.emplace_back("---:");
      for (std::size_t k = 0; k < rows.size(); ++k) rows[k].push_back(words_of(table.lines[k].cells[i]));
    };
    const auto add_value = [&](const char* title, std::optional<double> TableCell::*member) {
      if (!any_cell(table, i, member)) return;
      add(title, [&](const std::optional<TableCell>& cell) {
        return cell && (*cell).*member ? spelled(*((*cell).*member), column) : std::string("-");
      });
    };
    add(column.title, [&](const std::optional<TableCell>& cell) { return in_markdown(cell, column); });
    add_value("guess", &TableCell::guess);
    add_value("paper", &TableCell::paper);
  }
  std::string out = "## " + protocol_title(table.protocol) + "\n\n" + markdown_row(head) + markdown_row(rule);
  for (const auto& row : rows) out += markdown_row(row);
  return out + "\n" + differences_in_markdown(table);
}

std::vector<std::string> names_of(const std::vector<TableLog>& logs) {
  std::vector<std::string> names;
  for (const TableLog& log : logs) names.push_back(log.name);
  return names;
}

}  // namespace

TableFigures table_figures(const TablePlan& plan, const FiguresOf& figures_of) {
  TableFigures figures;
  note_missing(figures, plan, figures_of);
  for (const std::string& protocol : plan.request.protocols) {
    ProtocolTable table = table_of(plan, protocol, figures_of);
    if (!table.lines.empty() && !table.columns.empty()) figures.tables.push_back(std::move(table));
  }
  return figures;
}

std::string spelled(double value, const TableColumn& column) { return fmt::format("{:.{}f}", value, column.digits); }

std::string spelled(const TableCell& cell, const TableColumn& column) {
  return spelled(cell.mean, column) + (cell.spread ? " +- " + spelled(*cell.spread, column) : "");
}

std::string spelled(const TableDifference& difference, const TableColumn& column) {
  return fmt::format("{:+.{}f}", difference.mean, column.digits) +
         (difference.spread ? " +- " + spelled(*difference.spread, column) : "") +
         text(" (better in ", difference.better, " of ", difference.pairs, ")");
}

nlohmann::ordered_json to_json(const TableFigures& figures, const TablePlan& plan) {
  Report json = {{"schema_version", 1}, {"size", plan.request.small ? "small" : "paper"}};
  json["training_logs"] = plan.request.logs.train.size();
  json["measured_logs"] = names_of(plan.request.logs.measured);
  json["seeds"] = plan.request.seeds;
  json["feature_networks"] = figures.networks;
  json["tables"] = Report::array();
  for (const ProtocolTable& table : figures.tables) json["tables"].push_back(to_json(table));
  json["missing"] = figures.missing;
  return json;
}

std::string to_markdown(const TableFigures& figures, const TablePlan& plan) {
  std::string out = "# GenAssets' tables, measured here\n\n";
  std::vector<std::string> seeds;
  for (const int64_t seed : plan.request.seeds) seeds.push_back(std::to_string(seed));
  out += text("Size ", plan.request.small ? "small" : "paper", ": ", plan.request.logs.train.size(),
              " training logs; measured: ", joined(names_of(plan.request.logs.measured)), "; seeds ", joined(seeds),
              figures.networks.empty() ? "" : "; features by " + joined(figures.networks), ".\n\n",
              "Means over the measured logs and the seeds, +- the standard deviation of the seeds. \"guess\" is the "
              "best of those\nthat know nothing (a copy or a blend of the nearest images, mean colours, random codes); "
              "\"paper\" is GenAssets,\nTables A2 and A3, on PandaSet. Below each table: how rows differ from the "
              "first, paired by measured log and seed.\n\n");
  for (const ProtocolTable& table : figures.tables) out += to_markdown(table);
  if (!figures.missing.empty()) out += "Not measured: " + joined(figures.missing) + "\n";
  return out;
}

}  // namespace cloam
