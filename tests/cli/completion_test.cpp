// What cloam completion writes, used as shells and man use it.
#include <doctest/doctest.h>

#include <cstdlib>
#include <iostream>
#include <sstream>

#include "models/methods/registry.h"
#include "tests/cli/process.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

fs::path written(const std::string& shell) {
  const fs::path file = scratch() / ("completion." + shell);
  if (fs::exists(file)) return file;
  const Outcome outcome = cloam_with({"completion", shell});
  REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
  write_text(file, outcome.out);
  return file;
}

bool is_there(const std::string& program) {
  if (std::system(("command -v " + program + " >/dev/null 2>&1").c_str()) == 0) return true;
  std::cerr << "not checked: " << program << " is not installed\n";
  return false;
}

std::string output_of(const std::string& line) {
  const fs::path out = scratch() / "completion-out";
  CHECK_MESSAGE(std::system((line + " >'" + out.string() + "' 2>&1").c_str()) == 0, line);
  return content_of(out);
}

/// What bash offers where the words end; the last may be begun.
std::vector<std::string> offered_by_bash(const Words& words) {
  std::string script = "source '" + written("bash").string() + "'; COMP_WORDS=(cloam";
  for (const std::string& word : words) script += " '" + word + "'";
  script += "); COMP_CWORD=" + std::to_string(words.size()) + R"(; _cloam; printf "%s\n" "${COMPREPLY[@]}")";
  const fs::path file = scratch() / "complete.sh";
  write_text(file, script);
  std::istringstream lines(output_of("bash '" + file.string() + "'"));
  std::vector<std::string> offered;
  for (std::string line; std::getline(lines, line);)
    if (!line.empty()) offered.push_back(line);
  return offered;
}

}  // namespace

TEST_CASE("completion: bash completes commands, options, methods, presets and words of a list") {
  using Offers = std::vector<std::string>;
  CHECK(offered_by_bash({"tra"}) == Offers{"train"});
  CHECK(offered_by_bash({"co"}) == Offers{"compare", "convert", "config", "completion"});
  CHECK(offered_by_bash({"train", ""}) == method_names());
  CHECK(offered_by_bash({"train", "ner"}) == Offers{"nerf"});
  CHECK(offered_by_bash({"train", "nerf", "DATA", "--time"}) == Offers{"--time-budget"});
  CHECK(offered_by_bash({"train", "nerf", "DATA", "--preset", "nerf"}) == Offers{"nerf", "nerf-paper"});
  CHECK(offered_by_bash({"train", "nerf", "DATA", "--masks", ""}) == Offers{"ignore", "transparent"});
  CHECK(offered_by_bash({"eval", "runs/fox", "--pro"}) == Offers{"--protocol", "--profile", "--profile-trace"});
  CHECK(offered_by_bash({"train", "nerf", "DATA", "--dry-run", "--time"}) ==
        Offers{"--time-budget"});                                                  // no word follows
  CHECK(offered_by_bash({"train", "nerf", "DATA", "--steps", "--time"}).empty());  // one does
  CHECK(offered_by_bash({"help", "sim"}) == Offers{"simulate"});
  CHECK(offered_by_bash({"config", "sch"}) == Offers{"schema"});
  CHECK(offered_by_bash({"train", "nerf", ""}).empty());  // files: bash's own
}

TEST_CASE("completion: zsh and fish find no mistake in their scripts, which name every command") {
  for (const char* shell : {"zsh", "fish"}) {
    const fs::path script = written(shell);
    if (is_there(shell)) CHECK(output_of(std::string(shell) + " -n '" + script.string() + "'") == "");
    const std::string content = content_of(script);
    for (const std::string& method : method_names()) CHECK(contains(content, method));
    for (const char* command : {"train", "eval", "simulate", "config", "completion"}) CHECK(contains(content, command));
    CHECK(contains(content, std::string(shell) == "fish" ? "-l time-budget" : "--time-budget["));
  }
}

TEST_CASE("completion: the man page has every command and option, and groff has nothing to say of it") {
  const fs::path page = written("man");
  if (!is_there("groff")) return;
  CHECK(output_of("groff -man -Tascii -ww -z '" + page.string() + "'") == "");
  const std::string shown = output_of("groff -man -Tascii -P-cbou '" + page.string() + "'");
  for (const char* words : {"NAME", "SYNOPSIS", "cloam train METHOD DATA", "--time-budget", "EXIT STATUS",
                            "--require-gpu", "--seed N", "-o, --out WORD"})
    CHECK_MESSAGE(contains(shown, words), words);
  CHECK_FALSE(contains(shown, "--json WORD"));
}
