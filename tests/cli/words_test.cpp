// What the program says: help that fits a screen, messages that name only what exists, plain words for typing errors.
#include <doctest/doctest.h>

#include <algorithm>
#include <regex>
#include <set>
#include <sstream>

#include "models/methods/registry.h"
#include "models/train/config.h"
#include "tests/cli/documents.h"
#include "tests/cli/process.h"
#include "tests/cli/small_street.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

using Names = std::set<std::string>;

std::vector<std::string> lines_of(const std::string& text) {
  std::istringstream stream(text);
  std::vector<std::string> lines;
  for (std::string line; std::getline(stream, line);) lines.push_back(line);
  return lines;
}

std::vector<std::string> matches(const std::string& text, const std::string& pattern, std::size_t group = 1) {
  const std::regex expression(pattern);
  std::vector<std::string> found;
  for (std::sregex_iterator match(text.begin(), text.end(), expression), end; match != end; ++match)
    found.push_back((*match)[group]);
  return found;
}

const Words kCommands = {"train",  "eval",    "compare",    "tables", "distance", "crops",   "render",
                         "export", "convert", "generate",   "edit",   "simulate", "process", "check",
                         "demo",   "synth",   "info",       "doctor", "selftest", "bench",   "tune",
                         "view",   "config",  "completion", "report"};

/// What --help prints, for each command.
const std::map<std::string, std::string>& helps() {
  static const std::map<std::string, std::string> all = [] {
    std::map<std::string, std::string> texts;
    for (const std::string& command : kCommands) texts[command] = cloam_with({command, "--help"}).out;
    return texts;
  }();
  return all;
}

/// The options of a command, by the lines that describe them.
Names options_of(const std::string& command) {
  Names names;
  for (const std::string& line : lines_of(helps().at(command)))
    for (const std::string& name : matches(line, "^  (?:-\\w,)?(--[a-z-]+)")) names.insert(name);
  return names;
}

Names all_options() {
  Names names = {"--version"};
  for (const std::string& command : kCommands) names.merge(options_of(command));
  return names;
}

Names all_settings() {
  Names keys;
  for (const std::string& method : method_names()) {
    Config config;
    make_method(method)->configure(config);
    for (const ConfigEntry& entry : config.entries()) keys.insert(entry.key);
  }
  return keys;
}

/// The string literals of C++ text, plain and raw.
std::vector<std::string> literals_of(const std::string& text) {
  std::vector<std::string> literals;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text.compare(i, 2, "//") == 0) {
      i = std::min(text.find('\n', i), text.size());
    } else if (text[i] == '\'' && i > 0 && !std::isalnum(static_cast<unsigned char>(text[i - 1]))) {
      i = text.find('\'', i + (text[i + 1] == '\\' ? 3 : 2));
    } else if (text.compare(i, 3, "R\"(") == 0) {
      const std::size_t end = text.find(")\"", i);
      literals.push_back(text.substr(i + 3, end - i - 3));
      i = end + 1;
    } else if (text[i] == '"') {
      std::size_t end = i + 1;
      while (text[end] != '"') end += text[end] == '\\' ? 2 : 1;
      literals.push_back(text.substr(i + 1, end - i - 1));
      i = end;
    }
  }
  return literals;
}

/// Every literal of the program with its file.
std::vector<std::pair<std::string, std::string>> program_literals() {
  std::vector<std::pair<std::string, std::string>> all;
  for (const char* folder : {"cli", "models", "runtime"})
    for (const auto& entry : fs::recursive_directory_iterator(fs::path(CLOAM_SOURCE) / folder)) {
      const fs::path& path = entry.path();
      if (path.extension() != ".cpp" && path.extension() != ".h") continue;
      for (const std::string& literal : literals_of(content_of(path))) all.emplace_back(path.string(), literal);
    }
  return all;
}

/// Options in our literals that are those of other programs.
const std::map<std::string, std::string> kForeignOptions = {
    {"--database_path", "colmap"},
    {"--image_path", "colmap"},
    {"--input_path", "colmap"},
    {"--output_path", "colmap"},
    {"--output_type", "colmap"},
    {"--output-dir", "ns-process-data"},
    {"--gpus", "docker"},
    {"--iterations", "3dgs"},
    {"--max-num-iterations", "nerfstudio"},
    {"--image_list_path", "colmap"},
    {"--total-steps", "brush"},
    {"--max-steps", "gsplat"},
    {"--output", "COLMAP and others"},
    {"--model_path", "3dgs"},
    {"--data-factor", "gsplat"},
    {"--test-every", "gsplat"},
};

/// Those that the documents alone name.
const Names kForeignInDocuments = {"--data-races",
                                   "--uniform-writes",  // Oclgrind's
                                   "--install",
                                   "--prefix",
                                   "--component",
                                   "--build",  // CMake's
                                   "--cflags",
                                   "--libs",    // pkg-config's
                                   "--logdir",  // TensorBoard's
                                   "--log-seed",
                                   "--both-places",  // script/moved-actors's
                                   "--rm",
                                   "--user",
                                   "--gpus",
                                   "--group-add",
                                   "--build-arg",  // docker's
                                   "--nodes",
                                   "--ntasks-per-node",
                                   "--gpus-per-node",
                                   "--signal",  // SLURM's
                                   "--nv",
                                   "--bind",        // Apptainer's
                                   "--apptainer"};  // of script/package-test

const std::string kOption = "(?:^|[^A-Za-z0-9_-])(--[a-z][a-z0-9_-]*)";

/// What a document says of this program: without the cells of others.
std::string ours_of(const fs::path& document) {
  const std::string text = content_of(document);
  if (!comes_from_elsewhere(document)) return text;
  std::string ours;
  for (const std::string& line : lines_of(text)) ours += without_first_cell(line) + "\n";
  return ours;
}

/// The words of an example: up to the comment behind it, which three blanks or a # begin.
Words words_of(std::string line) {
  line = line.substr(0, std::min(line.find("   "), line.find(" #")));
  Words words;
  std::istringstream stream(line);
  for (std::string word; stream >> word;) words.push_back(word);
  return words;
}

}  // namespace

TEST_CASE("every option that a message names exists") {
  const Names known = all_options();
  REQUIRE(known.size() > 60);
  Names foreign;
  for (const auto& [path, literal] : program_literals())
    for (const std::string& option : matches(literal, kOption)) {
      if (kForeignOptions.contains(option))
        foreign.insert(option);
      else
        CHECK_MESSAGE(known.contains(option), path << " names " << option << " in: " << literal);
    }
  for (const auto& [option, program] : kForeignOptions) CHECK_MESSAGE(foreign.contains(option), option);
}

TEST_CASE("every setting that a message names exists") {
  const Names known = all_settings();
  REQUIRE(known.size() > 100);
  Names families;
  for (const std::string& key : known) families.insert(key.substr(0, key.find('.')));
  int named = 0;
  for (const auto& [path, literal] : program_literals()) {
    for (const std::string& key : matches(literal, "--set ([a-z0-9_.]+)[= *]")) {
      const bool family = key.ends_with('.') && families.contains(key.substr(0, key.size() - 1));  // --set batch.*
      if (key == "key") continue;                                                                  // --set key=value
      CHECK_MESSAGE((family || known.contains(key)), path << " names --set " << key << " in: " << literal);
      ++named;
    }
    if (!contains(literal, " ")) continue;  // no message: a name of a file or tensor
    for (const std::string& key : matches(literal, "(?:^|[ (])([a-z]+\\.[a-z][a-z0-9_]*)=")) {
      if (!families.contains(key.substr(0, key.find('.')))) continue;
      CHECK_MESSAGE(known.contains(key), path << " names " << key << " in: " << literal);
      ++named;
    }
  }
  CHECK(named > 5);
}

TEST_CASE("every option and setting that the documents name exists") {
  const Names options = all_options(), settings = all_settings();
  for (const fs::path& document : documents()) {
    const std::string text = ours_of(document);
    for (const std::string& option : matches(text, kOption))
      CHECK_MESSAGE((options.contains(option) || kForeignInDocuments.contains(option)), document.string()
                                                                                            << " names " << option);
    for (const std::string& key : matches(text, "--set ([a-z_]+\\.[a-z0-9_]+)="))
      CHECK_MESSAGE(settings.contains(key), document.string() << " names --set " << key);
  }
}

TEST_CASE("every command that the documents name exists") {
  int count = 0;
  for (const fs::path& document : documents())
    for (const std::string& command : matches(ours_of(document), "`cloam ([a-z]+)")) {
      const bool known = helps().contains(command) || command == "help" || command == "version";
      CHECK_MESSAGE(known, document.string() << " names cloam " << command);
      ++count;
    }
  CHECK(count > 60);
}

TEST_CASE("help fits a screen, whichever way it is asked for") {
  const std::string all = cloam_with({"--help"}).out;
  CHECK(lines_of(all).size() <= 40);
  CHECK(cloam_with({"help"}).out == all);
  CHECK(cloam_with({}).out == all);
  CHECK(contains(cloam_with({"version"}).out, "cloam 0."));
  for (const std::string& command : kCommands) {
    CAPTURE(command);
    const std::string& help = helps().at(command);
    CHECK(contains(all, "cloam " + command));
    CHECK(lines_of(help).size() <= 66);
    for (const std::string& line : lines_of(help)) CHECK_MESSAGE(line.size() <= 125, line);
  }
  CHECK(cloam_with({"help", "train"}).out == helps().at("train"));
  const Outcome wrong = cloam_with({"help", "trian"});
  CHECK(wrong.code == 2);
  CHECK(contains(wrong.err, "did you mean train?"));
}

TEST_CASE("the examples of every help name commands and options that exist") {
  int count = 0;
  for (const auto& [command, help] : helps())
    for (const std::string& line : lines_of(help)) {
      if (!line.starts_with("  cloam ")) continue;
      const Words words = words_of(line);
      REQUIRE_MESSAGE(helps().contains(words.at(1)), line);
      const Names known = options_of(words[1]);
      for (const std::string& word : words)
        if (word.starts_with("--")) CHECK_MESSAGE(known.contains(word.substr(0, word.find('='))), line);
      ++count;
    }
  CHECK(count > 60);
}

TEST_CASE("a word where a number belongs: exit 2 and one short line") {
  Names tried;
  for (const std::string& command : kCommands)
    for (const std::string& line : lines_of(helps().at(command)))
      for (const std::string& option : matches(line, "^  (?:-\\w,)?(--[a-z-]+) N")) {
        if (!tried.insert(option).second) continue;  // the same check in several commands
        const Outcome outcome = cloam_with({command, option, "ten"});
        CAPTURE(command);
        CHECK(outcome.code == 2);
        CHECK_MESSAGE(contains(outcome.err, "error: " + option + " ten: want a "), outcome.err);
        CHECK_MESSAGE(outcome.err.size() < 120, outcome.err);
      }
  CHECK(tried.size() > 20);
  CHECK(contains(cloam_with({"train", "nerf", "x", "--steps", "0"}).err, "--steps 0: want a whole number above 0"));
  CHECK(contains(cloam_with({"train", "nerf", "x", "--steps", "2.5"}).err, "--steps 2.5: want a whole number above 0"));
  CHECK(contains(cloam_with({"render", "x", "-o", "y", "--frames", "99999"}).err, "from 1 to 10000"));
  CHECK(contains(cloam_with({"train", "nerf", "x", "--masks", "transparant"}).err, "did you mean transparent?"));
}

TEST_CASE("a word that is missing is told with what it means and an example") {
  const Outcome no_run = cloam_with({"eval"});
  CHECK(no_run.code == 2);
  CHECK(contains(no_run.err, "cloam eval needs RUN: Run folder"));
  CHECK(contains(no_run.err, "example: cloam eval runs/fox\n"));
  const Outcome no_out = cloam_with({"render", "runs/my"});
  CHECK(contains(no_out.err, "cloam render needs --out: Folder"));
  CHECK(contains(no_out.err, "example: cloam render runs/fox -o pictures\n"));
  const Outcome no_value = cloam_with({"train", "nerf", "DATA", "--steps"});
  CHECK(no_value.code == 2);
  CHECK(contains(no_value.err, "a value is missing for --steps: "));
}

TEST_CASE("a memory budget without its unit is refused; one that is too small is told what would do") {
  const std::string data = small_scene().string();
  const Outcome bare = cloam_with({"train", "nerf", data, "-o", (scratch() / "bare").string(), "--max-memory", "3"});
  CHECK(bare.code == 2);
  CHECK(contains(bare.err, "\"3\" is 3 bytes: want 600M or 6G"));
  const Outcome small = cloam_with(small_training(small_scene(), scratch() / "little", {"--max-memory", "300K"}));
  REQUIRE_MESSAGE(small.code == 5, small.err);
  const auto wanted = matches(small.err, "--max-memory (\\w+)");
  REQUIRE_MESSAGE(wanted.size() == 1, small.err);
  const Outcome enough =
      cloam_with(small_training(small_scene(), scratch() / "little", {"--max-memory", wanted.front(), "--dry-run"}));
  CHECK_MESSAGE(enough.code == 0, enough.err);
}

TEST_CASE("simulate tells the time left of images and sweeps apart until both were measured") {
  const fs::path out = scratch() / "simulated";
  const Outcome outcome = cloam_with({"simulate", small_street_run().string(), "-o", out.string(), "--size", "24x16"});
  REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
  const std::string lines = "\n" + outcome.err;  // with a warm kernel cache no line precedes the first one
  CHECK(matches(lines, "\nsimulate \\d/3  front_camera \\d  (\\d+s left for images, then 3 sweeps)").size() == 3);
  CHECK(matches(lines, "\nsimulate \\d/3  sweep \\d  (\\d+s left)").size() == 3);
}

TEST_CASE("seconds of compiling are told where no terminal shows them, and not with -q") {
  const fs::path pictures = scratch() / "compiled-pictures";
  REQUIRE(cloam_with({"synth", "-o", pictures.string(), "--logs", "1", "--frames", "2", "--size", "48x48", "--cameras",
                      "front", "--no-truth", "-q"})
              .code == 0);
  const std::string folder = (pictures / "001/camera/front_camera").string();
  for (const char* quiet : {"", "-q"}) {
    const fs::path cache = scratch() / ("cache" + std::string(quiet));
    fs::create_directories(cache);
    Words words = {"distance", folder, folder, "--features", "random", "--profile"};
    if (*quiet) words.push_back(quiet);
    const Outcome outcome = cloam_with(words, {"POCL_CACHE_DIR=" + cache.string()});
    REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
    const auto seconds = matches(outcome.err, "compiling (\\d+\\.\\d+) s");
    REQUIRE_MESSAGE(seconds.size() == 1, outcome.err);
    const bool told = !*quiet && std::stod(seconds.front()) >= 1;
    CHECK(contains(outcome.err, "compiling kernels for this device (kept for the next run) ...\n") == told);
    CHECK(matches(outcome.err, "\n(compiled \\d+ kernels in \\d+s)\n").size() == (told ? 1 : 0));
  }
}

TEST_CASE("methods are known by the names they have elsewhere") {
  const std::pair<const char*, const char*> aliases[] = {
      {"3dgs", "splat"},    {"splatfacto", "splat"}, {"gaussian-splatting", "splat"},
      {"nerfacto", "nerf"}, {"instant-ngp", "nerf"}, {"ngp", "nerf"}};
  for (const auto& [alias, method] : aliases) {
    CHECK(method_of_alias(alias) == method);
    CHECK(method_of_alias(method) == method);
  }
  const Outcome unknown = cloam_with({"train", "colmap-mvs", small_scene().string()});
  CHECK(unknown.code == 2);
  CHECK(contains(
      unknown.err,
      "unknown method colmap-mvs  [exit 2]\n  want one of nerf, splat, genassets, street-gaussians, neurad, zipnerf, "
      "diffusion\n"));
  const fs::path run = scratch() / "alias";
  const Outcome outcome = cloam_with({"train", "nerfacto", small_scene().string(), "-o", run.string(), "--dry-run"});
  CHECK_MESSAGE(outcome.code == 0, outcome.err);
  CHECK(contains(outcome.err, "nerfacto is called nerf here: training nerf\n"));
}
