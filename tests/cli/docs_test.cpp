// What the documents tell to type is typed here: every sh block of README.md and docs/, and our side of the tables in
// docs/coming-from, from top to bottom, from an empty folder. Budgets are cut to a few steps and sizes to the least by
// the rules below; nothing else is changed.
#include <doctest/doctest.h>

#include <algorithm>
#include <cstdlib>
#include <iostream>
#include <nlohmann/json.hpp>
#include <regex>
#include <sstream>

#include "models/synth/synthetic_scene.h"
#include "tests/cli/documents.h"
#include "tests/cli/process.h"
#include "tests/cli/small_street.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

struct Rule {
  const char *pattern, *replacement;
};

/// In this order, on each line.
const Rule kRules[] = {
    // Steps, pictures and sizes.
    {" --time-budget \\S+", " --steps 2"},
    {" --steps \\d+", " --steps 2"},
    {"^(cloam train genassets (?!.*--networks).*) --steps 2", "$1 --steps 8"},  // most actors are seen
    {"(--resume \\S+) --steps 2", "$1 --steps 3"},
    {" --downscale \\d+", " --downscale 1"},
    {" --augment \\d+", " --augment 1"},
    {" --logs \\d\\d+", " --logs 2"},
    {" --frames \\d+", ""},
    {" --size \\S+", ""},
    {" --cameras \\S+", ""},
    {" -n \\d+", " -n 2"},
    {"^cloam synth", "cloam synth --frames 6 --size 48x27 --cameras front --beams 24"},
    {"^cloam render (.*) --path (orbit|interpolated)", "cloam render $1 --path $2 --frames 2"},
    {"^cloam render (.*) --time", "cloam render $1 --size 48x27 --time"},
    {"^cloam generate", "cloam generate --frames 2 --size 16 --resolution 8 --steps 2"},
    {"^cloam export (.*) --actor", "cloam export $1 --resolution 8 --actor"},
    {"^cloam export runs/my -o (\\S+) --resolution \\d+", "cloam export runs/my -o $1 --resolution 16 --level 0.0001"},
    {"^cloam simulate (.*) --augment", "cloam simulate $1 --size 24x16 --augment"},
    {"^cloam bench (.*) --json", "cloam bench $1 --rounds 1 --json"},
    {"^cloam selftest --quick", "cloam selftest --only negate"},  // selftest_test.cpp runs the rows
    // Pictures of trainings where they are what a page shows: elsewhere they take longer than the steps.
    {"^(cloam train (?!.*(--pictures|--preview-every|--tb|--view|--dry-run|runs/my|runs/drawn)).*)$",
     "$1 --pictures off"},
    // Models.
    {" --set (batch|background)\\.\\S+", ""},
    {"^cloam train nerf",
     "cloam train nerf --set field.log2_rows=10 --set field.levels=4 --set batch.rays=64 --set batch.samples=4096"
     " --set occupancy.side=16 --set occupancy.cells=512"},
    {"^cloam train street-gaussians",
     "cloam train street-gaussians --set initial.lidar=200 --set initial.near=20 --set initial.far=20"
     " --set initial.actor=20 --set initial.fewest=20 --set sky.side=4"},
    {"^cloam train zipnerf",
     "cloam train zipnerf --set grid.log2_rows=10 --set proposals.log2_rows=8 --set batch.rays=64"
     " --set samples.proposal=8 --set samples.field=8"},
    {"^cloam train neurad",
     "cloam train neurad --set grid.log2_rows=10 --set actors.log2_rows=8 --set batch.patches=1 --set "
     "batch.patch_side=8"
     " --set batch.lidar_rays=32"},
    {"^cloam train splat", "cloam train splat --set initial.random=200"},
    {"^cloam train genassets (?!.*--networks)",
     "cloam train genassets --set background.side=32 --set batch.patches=2 --set batch.patch_side=8"
     " --set batch.lidar_rays=32 --set code.side=4 --set code.channels=4 --set decoder.middle=16"
     " --set decoder.widths=16,8,8 --set decoder.groups=4 --set weight.perceptual=0 --set prior.steps=2 "},
    {"^cloam train genassets (?=.*--networks)", "cloam train genassets --set prior.steps=2 "},
    {"^cloam train diffusion", "cloam train diffusion --set unet.base=8 --set unet.groups=4 --set batch.codes=8"},
    {"^cloam tables",
     "cloam tables --size small --train @/logs/001 --measure @/logs/003 --rows full --protocols sparse"
     " --steps train=2,fit=2 --set background.side=32 --set batch.patches=1 --set batch.patch_side=8"
     " --set batch.lidar_rays=32 --set code.side=4 --set weight.perceptual=0"},
    // Places: what the reader has and the test makes.
    {"\\bDATA\\b", "@/photos"},
    {"\\bLOG\\.\\.\\.", "@/logs/001 @/logs/002"},
    {"\\bNEWLOG\\b|\\bLOG\\b|\\bKITTI\\b", "@/logs/003"},  // kitti_test.cpp reads the real layout
    {"\\bPANDASET/00\\[1-8\\]", "@/logs/00[12]"},
    {" --features SQUEEZENET --photos CROPS", ""},  // two logs are too few; prior_photos_test.cpp runs it
    {" --set perceptual.weights=SQUEEZENET| --features SQUEEZENET", ""},
};

struct Exception {
  const char *line, *reason;
};

/// Lines that are not run, by their beginnings.
const Exception kExceptions[] = {
    {"script/demo", "builds the program; demo_test.cpp runs cloam demo"},
    {"script/test", "runs this test"},
    {"cloam view", "serves until it is ended; view_test.cpp runs it"},
    {"ssh -L", "needs another computer"},
    {"cloam export runs/my --format points", "two steps learn no surface; geometry_pictures_test.cpp makes points"},
    {"cloam process photos -o DATA", "needs COLMAP and photos of one thing; colmap_test.cpp runs it"},
    {"cloam process walk.mp4 -o DATA", "needs ffmpeg, COLMAP and a video; video_test.cpp runs it"},
};

/// Our commands in a row of a table: what stands in `` in all cells but the first, which is the other program's.
std::vector<std::string> commands_in_row(const std::string& line) {
  std::vector<std::string> commands;
  static const std::regex ours("`(cloam [^`]*)`");
  const std::string cells = without_first_cell(line);
  for (std::sregex_iterator match(cells.begin(), cells.end(), ours), end; match != end; ++match)
    commands.push_back((*match)[1]);
  return commands;
}

/// The commands of the sh blocks, with continued lines joined and comments gone. Other blocks hold no command of ours.
/// Pages for those who come from another program hold commands in tables.
std::vector<std::string> commands_in(const fs::path& document) {
  std::istringstream text(content_of(document));
  std::vector<std::string> commands;
  std::string fence, joined;
  for (std::string line; std::getline(text, line);) {
    if (line.starts_with("```")) {
      fence = fence.empty() ? line : "";
      continue;
    }
    if (fence.empty() && line.starts_with("| ") && comes_from_elsewhere(document))
      for (const std::string& command : commands_in_row(line)) commands.push_back(command);
    if (fence.empty()) continue;
    CHECK_MESSAGE((fence == "```sh" || !line.starts_with("cloam ")), document.string()
                                                                         << ": a block without sh: " << line);
    if (fence != "```sh") continue;
    const std::size_t comment = line.find(" #");
    line = joined + line.substr(0, comment);
    line.erase(line.find_last_not_of(' ') + 1);
    joined = line.ends_with('\\') ? line.substr(0, line.size() - 1) : "";
    if (!line.empty() && joined.empty()) commands.push_back(line);
  }
  return commands;
}

/// Photos, and three logs as README makes them.
const fs::path& places() {
  static const fs::path folder = [] {
    const fs::path made = scratch() / "places";
    write_synthetic_scene(made / "photos", {.train = 8, .test = 2, .size = 32});
    const Outcome logs = cloam_with({"synth", "-o", (made / "logs").string(), "--logs", "3", "--frames", "6", "--size",
                                     "48x27", "--cameras", "front", "--beams", "24", "--night", "0.4", "-q"});
    REQUIRE_MESSAGE(logs.code == 0, logs.err);
    return made;
  }();
  return folder;
}

std::string cut_down(std::string line) {
  for (const Rule& rule : kRules) line = std::regex_replace(line, std::regex(rule.pattern), rule.replacement);
  for (std::size_t at; (at = line.find('@')) != std::string::npos;) line.replace(at, 1, places().string());
  return line;
}

struct Shell {
  int code;
  std::string out, err;
};

Shell run(const std::string& line, const fs::path& folder) {
  const fs::path out = scratch() / "shell-out", err = scratch() / "shell-err";
  const std::string bin = fs::path(CLOAM_BINARY).parent_path().string();
  const std::string whole = "cd '" + folder.string() + "' && PATH='" + bin + "':$PATH && { " + line + "\n} >'" +
                            out.string() + "' 2>'" + err.string() + "'";
  const int code = std::system(whole.c_str());
  return {code, content_of(out), content_of(err)};
}

/// The actor that most images show, by what `edit --list --json` prints of one run of each scene.
std::string actor_of(const std::string& run_name, const fs::path& folder) {
  static std::map<std::string, std::string> known;
  std::string& id = known[content_of(folder / run_name / "scene.json")];
  if (!id.empty()) return id;
  const Shell listed = run("cloam edit " + run_name + " --list --json", folder);
  REQUIRE_MESSAGE(listed.code == 0, listed.err);
  const auto actors = nlohmann::json::parse(listed.out).at("actors");
  const auto most = std::max_element(actors.begin(), actors.end(),
                                     [](const auto& a, const auto& b) { return a.at("images") < b.at("images"); });
  return id = most->at("actor");
}

/// Two steps learn no surfaces, which meshes need.
void give_surfaces_to(const std::string& line, const fs::path& folder) {
  std::smatch match;
  if (!std::regex_search(line, match, std::regex("^cloam train genassets (?!.*--networks).* -o (\\S+)"))) return;
  const fs::path checkpoints = folder / match[1].str() / "ckpt";
  std::string latest = content_of(checkpoints / "latest.txt");
  latest.erase(latest.find_last_not_of("\n ") + 1);
  give_surfaces(checkpoints / latest);
}

/// A training that another document tells with the same words and data: its run is copied.
bool copied(const std::string& line, const fs::path& folder) {
  static std::map<std::string, fs::path> known;
  std::smatch match;
  if (!std::regex_search(line, match, std::regex("^cloam train (?!.*--networks (?!shipped)).* -o (\\S+)")))
    return false;
  if (line.find(places().string()) == std::string::npos) return false;  // its data are this document's own
  const std::string what = std::regex_replace(line, std::regex(" -o \\S+"), "");
  const auto [made, is_new] = known.emplace(what, folder / match[1].str());
  if (is_new) return false;
  fs::create_directories((folder / match[1].str()).parent_path());
  fs::copy(made->second, folder / match[1].str(), fs::copy_options::recursive);
  return true;
}

void type(const std::string& command, const fs::path& folder) {
  std::string line = cut_down(command);
  if (copied(line, folder)) return;
  std::smatch match;
  if (std::regex_search(line, match, std::regex("^cloam (?:edit|export) (\\S+).*\\bID\\b")))
    line = std::regex_replace(line, std::regex("\\bID\\b"), actor_of(match[1], folder));
  const Shell shell = run(line, folder);
  CHECK_MESSAGE(shell.code == 0, command << "\n  as " << line << "\n" << shell.err);
  give_surfaces_to(line, folder);
}

}  // namespace

TEST_CASE("every sh block of README and docs runs as typed, from an empty folder") {
  std::vector<std::string> left_out;
  for (const fs::path& document : documents()) {
    const fs::path folder = scratch() / ("typed-" + document.stem().string());
    fs::create_directories(folder);
    for (const std::string& command : commands_in(document)) {
      const auto exception = std::find_if(std::begin(kExceptions), std::end(kExceptions),
                                          [&](const Exception& e) { return command.starts_with(e.line); });
      if (exception != std::end(kExceptions))
        left_out.push_back(exception->line);
      else
        type(command, folder);
    }
  }
  for (const Exception& exception : kExceptions)
    CHECK_MESSAGE(std::count(left_out.begin(), left_out.end(), std::string(exception.line)) >= 1,
                  exception.line << " is no longer in the documents");
}
