// See tables_page.h.
#include "cli/tables_page.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "cli/commands.h"
#include "cli/page.h"
#include "models/eval/pictures.h"
#include "models/io/commit.h"
#include "models/io/image.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr int kWidestImage = 480;        // of a picture on the page
constexpr std::size_t kImagesShown = 2;  // of a log and protocol
constexpr char kReading[] =
    "Means over the measured logs and the seeds, &plusmn; the standard deviation of the seeds. <i>Guess</i> is the "
    "best "
    "of those that know nothing: a copy or a blend of the nearest images, mean colours, random codes; a figure in grey "
    "is no better. <i>Paper</i> is GenAssets, Tables A2 and A3, on PandaSet: other data, and other feature networks "
    "where the heading says so. Below, differences from the first row, paired by measured log and seed.";

std::string cell(const std::string& words, bool grey = false) {
  return std::string("<td class=\"number\"") + (grey ? " style=\"color:#999\">" : ">") + words + "</td>";
}

std::string cell_of(const std::optional<double>& value, const TableColumn& column) {
  return cell(value ? spelled(*value, column) : "");
}

/// A figure with its guess and the paper's beside it.
std::string cells_of(const std::optional<TableCell>& found, const TableColumn& column) {
  if (!found) return cell("-") + cell("") + cell("");
  std::string words = "<b>" + spelled(found->mean, column) + "</b>";
  if (found->spread) words += " &plusmn; " + spelled(*found->spread, column);
  if (found->measured < found->expected) words += fmt::format(" ({} of {})", found->measured, found->expected);
  return cell(words, found->beats_guess && !*found->beats_guess) + cell_of(found->guess, column) +
         cell_of(found->paper, column);
}

std::string table(const ProtocolTable& found) {
  std::string head = "<tr><th></th>", below = "<tr><th></th>", rows;
  for (const TableColumn& column : found.columns) {
    head += fmt::format("<th colspan=\"3\">{} ({} is better)</th>", escaped(column.title),
                        column.higher_is_better ? "more" : "less");
    below += "<th>here</th><th>guess</th><th>paper</th>";
  }
  for (const ProtocolTable::Line& line : found.lines) {
    rows += "<tr><td>" + escaped(line.row.title) + "</td>";
    for (std::size_t i = 0; i < line.cells.size(); ++i) rows += cells_of(line.cells[i], found.columns[i]);
    rows += "</tr>\n";
  }
  return "<table>" + head + "</tr>\n" + below + "</tr>\n" + rows + "</table>\n";
}

/// Rows minus the first, paired; nothing where the first is alone.
std::string differences(const ProtocolTable& found) {
  std::string rows;
  for (const ProtocolTable::Line& line : found.lines) {
    std::string cells;
    bool any = false;
    for (std::size_t i = 0; i < line.cells.size(); ++i) {
      const bool differs = line.cells[i] && line.cells[i]->from_first;
      any = any || differs;
      cells += cell(differs ? spelled(*line.cells[i]->from_first, found.columns[i]) : "-");
    }
    if (any) rows += "<tr><td>" + escaped(line.row.title) + "</td>" + cells + "</tr>\n";
  }
  if (rows.empty()) return "";
  std::string head = "<tr><th>minus " + escaped(found.lines.front().row.title) + "</th>";
  for (const TableColumn& column : found.columns) head += "<th>" + escaped(column.title) + "</th>";
  return "<table>" + head + "</tr>\n" + rows + "</table>\n";
}

/// The measurements of a log by a protocol, of each row the first seed's that was made.
std::vector<const TableNode*> measurements(const TableFolder& folder, const TablePlan& plan, const std::string& log,
                                           const std::string& protocol) {
  std::vector<const TableNode*> found;
  for (const TableRow& row : plan.request.rows)
    for (const TableNode& node : plan.nodes)
      if (node.row == row.key && node.log == log && node.protocol == protocol && is_done(folder, node)) {
        found.push_back(&node);
        break;
      }
  return found;
}

std::string title_of(const TablePlan& plan, const std::string& row) {
  const auto& rows = plan.request.rows;
  return std::find_if(rows.begin(), rows.end(), [&](const TableRow& one) { return one.key == row; })->title;
}

/// A picture at the size of the page, as a file and on it.
std::string shown(const TableFolder& folder, const std::string& name, const Image& image, const std::string& caption) {
  const fs::path file = folder.pictures() / (name + ".jpg");
  const double scale = std::min(1.0, static_cast<double>(kWidestImage) / image.width);
  const int width = std::max(1, static_cast<int>(std::lround(image.width * scale)));
  const int height = std::max(1, static_cast<int>(std::lround(image.height * scale)));
  Image small = resized(image, width, height);
  write_jpeg(file, small);
  return figure(file, caption, std::min(width * 2, 360));
}

/// One held-out image: the truth, then each row's render and error.
std::string image_rows(const TableFolder& folder, const TablePlan& plan, const std::vector<const TableNode*>& nodes,
                       const std::string& file, const std::string& name) {
  std::string renders, errors;
  for (const TableNode* node : nodes) {
    const fs::path sheet = folder.of(*node) / "images" / file;
    if (!fs::exists(sheet)) continue;
    const std::vector<Image> images = images_of_sheet(read_image(sheet), 3);
    const std::string title = title_of(plan, node->row);
    if (renders.empty()) {
      renders += shown(folder, name + "-truth", images[1], "truth");
      errors += figure(folder.pictures() / (name + "-truth.jpg"), "truth", std::min(images[1].width * 2, 360));
    }
    renders += shown(folder, name + "-" + node->row, images[0], title);
    errors += shown(folder, name + "-" + node->row + "-error", images[2], title + ": error, four times as bright");
  }
  return "<p>" + escaped(fs::path(file).stem().string()) + "</p>\n" + row_of(renders) + row_of(errors);
}

std::string pictures(const TableFolder& folder, const TablePlan& plan, const std::string& protocol) {
  std::string out;
  for (const TableLog& log : plan.request.logs.measured) {
    const auto nodes = measurements(folder, plan, log.name, protocol);
    if (nodes.empty()) continue;
    const std::vector<fs::path> files = files_in(folder.of(*nodes.front()) / "images", "", ".png");
    out += "<h3>" + escaped(log.name) + "</h3>\n";
    for (std::size_t i = 1; i <= std::min(kImagesShown, files.size()); ++i) {
      const fs::path& file = files[std::min(files.size() - 1, files.size() * i / (kImagesShown + 1))];
      out += image_rows(folder, plan, nodes, file.filename().string(), fmt::format("{}-{}-{}", protocol, log.name, i));
    }
  }
  return out;
}

std::string troubles(const char* heading, const std::vector<TableTrouble>& troubles) {
  if (troubles.empty()) return "";
  std::string lines;
  for (const TableTrouble& trouble : troubles)
    lines += "<li><b>" + escaped(trouble.id) + "</b>: " + escaped(trouble.error) + "</li>\n";
  return std::string("<h2>") + heading + "</h2>\n<ul>\n" + lines + "</ul>\n";
}

std::string commands(const TableFolder& folder, const TablePlan& plan) {
  std::string lines;
  for (const TableNode& node : plan.nodes) {
    std::vector<std::string> words;
    for (const std::string& word : node.words) words.push_back(folder.word(word));
    lines += escaped(typed(words)) + "\n";
  }
  return "<h2>The commands</h2>\n<pre>" + lines + "</pre>\n";
}

}  // namespace

void write_tables_page(const TableFolder& folder, const TablePlan& plan, const TableFigures& figures,
                       const std::vector<TableTrouble>& failed, const std::vector<TableTrouble>& left_out) {
  std::error_code error;
  fs::remove_all(folder.pictures(), error);
  std::string body = std::string("<p>") + kReading + "</p>\n" + troubles("Failed", failed) +
                     troubles("Left out, since what they need failed", left_out);
  for (const ProtocolTable& found : figures.tables)
    body += "<h2>" + escaped(protocol_title(found.protocol)) + "</h2>\n" + table(found) + differences(found) +
            pictures(folder, plan, found.protocol);
  commit_text(folder.page(), html_page("GenAssets' tables, measured here", body + commands(folder, plan)));
}

}  // namespace cloam
