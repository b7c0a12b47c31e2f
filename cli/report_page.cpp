// See report_page.h.
#include "cli/report_page.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

#include "cli/curves.h"
#include "cli/page.h"
#include "cli/run_history.h"
#include "models/eval/pictures.h"
#include "models/io/bytes.h"
#include "models/io/commit.h"
#include "models/io/image.h"
#include "models/io/json.h"
#include "models/io/words.h"
#include "models/methods/registry.h"
#include "models/runs/restore_run.h"
#include "models/runs/run_folder.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr int kWidest = 1200;                // of a picture on the page
constexpr uint64_t kLargestFilm = 64 << 20;  // bytes
constexpr std::size_t kPreviewsShown = 6;    // beside the newest
constexpr std::size_t kSheetsShown = 4;      // of an evaluation

using Rows = std::vector<std::pair<std::string, std::string>>;  // of a table: what, and HTML

std::string table(const Rows& rows) {
  std::string out = "<table>\n";
  for (const auto& [what, words] : rows)
    if (!words.empty()) out += "<tr><th>" + escaped(what) + "</th><td>" + words + "</td></tr>\n";
  return out + "</table>\n";
}

std::string section(const std::string& title, const std::string& body) {
  return body.empty() ? "" : "<h2>" + escaped(title) + "</h2>\n" + body;
}

/// No wider than the page.
std::string shown(const fs::path& file, const std::string& caption) {
  const Image image = read_image(file);
  if (image.width <= kWidest && file_bytes(file) < 100000) return figure(file, caption, image.width);
  const int width = std::min(image.width, kWidest);
  return figure(resized(image, width, std::max(1, image.height * width / image.width)), caption, width);
}

/// Small films larger, so that they can be looked at.
int width_on_page(const fs::path& gif) {
  const auto file = read_file(gif, kLargestFilm);
  ByteReader bytes(file, gif.string());
  bytes.skip(6, "its signature");
  const int width = bytes.little<std::uint16_t>("its width");
  return width < 240 ? 2 * width : width;
}

std::vector<fs::path> files_if_any(const fs::path& folder, const std::string& beginning, const std::string& ending) {
  std::error_code error;
  return fs::is_directory(folder, error) ? files_in(folder, beginning, ending) : std::vector<fs::path>();
}

std::vector<fs::path> previews_of(const fs::path& run) {
  std::vector<fs::path> files = files_if_any(RunPaths{run}.preview(), "step_", ".png");
  std::stable_sort(files.begin(), files.end(), [](const fs::path& a, const fs::path& b) {
    return a.filename().string().size() < b.filename().string().size();  // steps of more than six digits
  });
  return files;
}

/// "step 1,200" of step_001200.png.
std::string step_words(const fs::path& preview) {
  const std::string name = preview.stem().string();
  const auto step = number_in<int64_t>(std::string_view(name).substr(std::min(name.size(), name.find('_') + 1)));
  return step ? text("step ", *step) : name;
}

std::string state_words(const RunRecord& record) {
  const std::string done = record.horizon > 0
                               ? text(record.step, " of ", std::max(record.horizon, record.steps.value_or(0)), " steps")
                               : text(record.step, " steps");
  if (record.edited_from) return text("An edited run: the model of ", record.edited_from->given, " with other actors.");
  if (record.state == "finished") return text("Finished: ", done, ".");
  if (record.state == "running") return text("Unfinished: still running, or killed, after ", done, ".");
  return text("Unfinished: ", record.state, " after ", done, ".");
}

std::string data_words(const RunRecord& record) {
  std::string words;
  for (const RunData& data : record.data)
    words += escaped(data.given) + (data.fingerprint.empty() ? "" : " (" + escaped(data.fingerprint) + ")") + "<br>\n";
  return words;
}

std::string split_words(const RunRecord& record) {
  const Reading& how = record.reading;
  std::string words = how.holdout > 0 ? text("every ", how.holdout, "th image held out") : "";
  if (!how.protocol.name.empty()) words = "protocol " + how.protocol.name;
  if (!how.image.empty()) words = "the image " + how.image;
  if (how.downscale > 1) words += text(words.empty() ? "" : ", ", "images shrunk ", how.downscale, " times");
  return escaped(words);
}

std::string facts(const RunRecord& record, const RunHistory& history) {
  Rows rows = {{"Method", escaped(record.method + ", preset " + record.preset +
                                  (precision_of(record) == "mixed" ? ", mixed precision" : ""))},
               {"Data", data_words(record)},
               {"Reading", split_words(record)},
               {"Device", escaped(record.device + ", driver " + record.driver)},
               {"Seed", text(record.seed)},
               {"Started, ended", escaped(record.started + (record.ended.empty() ? "" : ", " + record.ended))},
               {"Program", escaped("cloam " + record.version)}};
  if (record.networks) rows.push_back({"Networks", escaped(record.networks->given)});
  if (record.prior) rows.push_back({"Prior", escaped(record.prior->given)});
  if (record.edited_from) rows.push_back({"Edited from", escaped(record.edited_from->given)});
  if (history.seconds > 0)
    rows.push_back({"Time", text(words_for_seconds(history.seconds),
                                 history.trainings > 1 ? text(", in ", history.trainings, " trainings") : "")});
  return table(rows);
}

std::string newest_preview(const fs::path& run) {
  const std::vector<fs::path> files = previews_of(run);
  return files.empty() ? "" : shown(files.back(), step_words(files.back()) + ": render, photo, error");
}

/// The first of a preview's three pictures; the whole of one that an earlier version wrote.
Image render_of(const fs::path& preview) {
  const Image sheet = read_image(preview);
  try {
    return images_of_sheet(sheet, 3).front();
  } catch (const Error&) { return sheet; }
}

/// What the training made of the preview's view over time: the renders alone, evenly chosen.
std::string previews_over_time(const fs::path& run) {
  const std::vector<fs::path> files = previews_of(run);
  if (files.size() < 2) return "";
  std::string figures;
  const std::size_t count = std::min(files.size(), kPreviewsShown);
  for (std::size_t i = 0; i < count; ++i) {
    const fs::path& file = files[(files.size() - 1) * i / (count - 1)];
    const Image render = render_of(file);
    figures += figure(render, step_words(file), std::min(render.width, 380));
  }
  return row_of(figures);
}

std::string turning_pictures(const fs::path& run) {
  const RunPaths paths{run};
  std::string figures;
  std::error_code error;
  if (fs::exists(paths.drive(), error))
    figures += figure(paths.drive(), "along the front camera's way", width_on_page(paths.drive()));
  if (fs::exists(paths.turntable(), error))
    figures += figure(paths.turntable(), "turntable", width_on_page(paths.turntable()));
  return figures;
}

std::string sheet(const fs::path& file, const std::string& caption) {
  std::error_code error;
  return fs::exists(file, error) ? row_of(shown(file, caption)) : "";
}

/// What is known of a figure of eval.json, in words.
std::string spelled_figure(const Json& value) {
  if (!value.is_number()) return "-";
  const double number = value.get<double>();
  return value.is_number_integer() ? text(value.get<int64_t>())
                                   : fmt::format("{:.{}f}", number, std::abs(number) < 1 ? 4 : 2);
}

/// "baseline_mean_colour_psnr" -> "baseline, mean colour, psnr": keys as docs/formats.md has them, each a row.
std::string evaluation(const fs::path& run, const RunRecord& record) {
  const fs::path file = RunPaths{run}.eval() / "eval.json";
  const std::string command = "cloam eval " + quoted(run.string());
  std::error_code error;
  if (!fs::exists(file, error))
    return "<p>Not evaluated yet. <code>" + escaped(command) +
           "</code> measures it on what was held out, beside what trivial guesses score; then make this page "
           "again.</p>\n";
  const Json json = parse_json_file(file);
  std::string body;
  if (const auto step = json.find("step");
      step != json.end() && step->is_number() && step->get<int64_t>() < record.step)
    body += text("<p>The evaluation is of step ", step->get<int64_t>(), "; the run has gone on since. <code>",
                 escaped(command), "</code> makes it anew.</p>\n");
  Rows figures, baselines, facts;
  for (const auto& [key, value] : json.items()) {
    if (key == "schema_version" || key == "per_image" || key == "logs" || key == "without_0" || key == "seconds")
      continue;
    if (!value.is_primitive()) continue;
    const bool words = value.is_string();
    Rows& rows = words || value.is_number_integer() ? facts : key.starts_with("baseline_") ? baselines : figures;
    rows.push_back({key, words ? escaped(value.get<std::string>()) : spelled_figure(value)});
  }
  const auto numbers = [](const char* heading, const Rows& rows) {
    std::string out = rows.empty() ? "" : text("<tr><th colspan=\"2\">", heading, "</th></tr>\n");
    for (const auto& [what, words] : rows)
      out += "<tr><td>" + escaped(what) + "</td><td class=\"number\"><b>" + words + "</b></td></tr>\n";
    return out;
  };
  return body + "<table>\n" + numbers("this run", figures) + numbers("what trivial guesses score", baselines) +
         numbers("how it was measured", facts) + "</table>\n<p>The names are explained in docs/formats.md.</p>\n";
}

std::string held_out_sheets(const fs::path& run) {
  const std::vector<fs::path> files = files_if_any(RunPaths{run}.eval() / "images", "", ".png");
  std::string out;
  for (std::size_t i = 0; i < std::min(kSheetsShown, files.size()); ++i) {
    const fs::path& file = files[files.size() <= kSheetsShown ? i : (files.size() - 1) * i / (kSheetsShown - 1)];
    out += shown(file, file.stem().string() + ": render, photo, error (four times as bright)");
  }
  return out.empty() ? "" : row_of(out);
}

/// Settings of the run that are not what its preset gives.
std::string other_settings(const RunRecord& record) {
  Config preset;
  std::map<std::string, std::string> usual;
  try {
    const auto method = make_method(record.method);
    method->configure(preset);
    for (const auto& [key, value] : find_preset(record.preset).settings) preset.set(key, value, "preset");
  } catch (const Error&) { return ""; }  // of another version of the program
  for (const ConfigEntry& entry : preset.entries()) usual[entry.key] = to_string(entry.value);
  std::string rows;
  for (const auto& [key, value] : record.settings) {
    const auto found = usual.find(key);
    if (found == usual.end() || found->second == value) continue;
    rows += "<tr><td>" + escaped(key) + "</td><td><b>" + escaped(value) + "</b></td><td>" + escaped(found->second) +
            "</td></tr>\n";
  }
  if (rows.empty()) return "<p>All settings are those of the preset.</p>\n";
  return "<table><tr><th>setting</th><th>here</th><th>preset</th></tr>\n" + rows + "</table>\n";
}

std::string warnings_of(const RunHistory& history) {
  std::string items;
  for (const std::string& warning : history.warnings) items += "<li>" + escaped(warning) + "</li>\n";
  return items.empty() ? "" : "<ul>\n" + items + "</ul>\n";
}

std::string commands(const fs::path& run, const RunRecord& record, const RunHistory& history) {
  std::string lines = history.commands.empty() ? record.command_line + "\n" : "";
  for (const std::string& command : history.commands) lines += command + "\n";
  const std::string folder = quoted(run.string());
  if (record.edited_from) {
    lines += "cloam render " + folder + " -o pictures\n";
  } else {
    if (record.state != "finished") lines += "cloam train --resume " + folder + "\n";
    lines += "cloam eval " + folder + "\n";
  }
  return "<p>On the same device, the same seed gives the same bytes. The settings are in config.toml.</p>\n<pre>" +
         escaped(lines) + "</pre>\n";
}

struct Size {
  std::size_t files = 0;
  uint64_t bytes = 0;
};

Size size_of(const fs::path& path) {
  Size size;
  std::error_code error;
  if (fs::is_regular_file(path, error)) return {1, fs::file_size(path, error)};
  for (fs::recursive_directory_iterator entry(path, error), end; !error && entry != end; entry.increment(error))
    if (entry->is_regular_file(error)) size.files++, size.bytes += entry->file_size(error);
  return size;
}

std::string size_words(uint64_t bytes) {
  return bytes < 1000000 ? fmt::format("{:.0f} kB", std::ceil(1e-3 * static_cast<double>(bytes)))
                         : words_for_bytes(bytes);
}

/// The report itself and its lock are left out: equal folders give equal pages.
std::string files(const fs::path& run) {
  std::map<std::string, Size> sizes;
  std::error_code error;
  for (fs::directory_iterator entry(run, error), end; !error && entry != end; entry.increment(error)) {
    const std::string name = entry->path().filename().string();
    if (name[0] != '.' && name != RunPaths{run}.report().filename()) sizes[name] = size_of(entry->path());
  }
  std::string rows;
  for (const auto& [name, size] : sizes)
    rows += text("<tr><td>", escaped(name), size.files > 1 ? text("/ (", size.files, " files)") : "",
                 "</td><td class=\"number\">", size_words(size.bytes), "</td></tr>\n");
  return "<table>\n" + rows + "</table>\n";
}

}  // namespace

fs::path main_picture(const fs::path& run) {
  const std::vector<fs::path> previews = previews_of(run);
  if (!previews.empty()) return previews.back();
  std::error_code error;
  if (fs::exists(RunPaths{run}.assets(), error)) return RunPaths{run}.assets();
  const std::vector<fs::path> measured = files_if_any(RunPaths{run}.eval() / "images", "", ".png");
  return measured.empty() ? fs::path() : measured.front();
}

void write_report_page(const fs::path& run, const fs::path& page) {
  const RunRecord record = read_record(run);
  const RunHistory history = read_history(RunPaths{run}.events());
  const bool has_photos = !learned_from_run(record);
  const std::string pictures = turning_pictures(run);
  std::string body = "<p><b>" + escaped(state_words(record)) + "</b></p>\n" + row_of(newest_preview(run) + pictures);
  if (pictures.empty())
    body +=
        "<p>There is no turntable yet: <code>cloam report " + escaped(quoted(run.string())) + "</code> makes it.</p>\n";
  body += sheet(RunPaths{run}.assets(), has_photos ? "the actors that most images show" : "generated assets") +
          facts(record, history) + section("Course of the training", curves_svg(history)) +
          section("The same view over time", previews_over_time(run)) + section("Measured", evaluation(run, record)) +
          section("Held-out views", held_out_sheets(run)) + section("Settings", other_settings(record)) +
          section("Warnings", warnings_of(history)) + section("How to reproduce it", commands(run, record, history)) +
          section("Files", files(run));
  commit_text(page, html_page(run.lexically_normal().filename().string() + ": " + record.method, body));
}

}  // namespace cloam
