// What a stranger who makes a mistake reads: golden_errors.txt holds the mistakes, each with the whole message. It says
// itself how it is written. With CLOAM_WRITE_GOLDEN set the file is written anew, for its diff to be read.
#include <doctest/doctest.h>

#include <cstdlib>
#include <regex>
#include <sstream>

#include "models/synth/synthetic_scene.h"
#include "runtime/error.h"
#include "tests/cli/process.h"
#include "tests/cli/small_street.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

const char* const kParts[] = {"looked for", "found", "fix"};

struct Mistake {
  std::string title, command, wanted;
  Words before;                              // lines of shell that make what the command meets
  std::map<std::string, std::string> parts;  // of the message
  std::string as_read;                       // the whole case
};

fs::path golden() { return fs::path(CLOAM_SOURCE) / "tests/cli/golden_errors.txt"; }

/// The value after a word at the beginning of a line.
bool after(const std::string& line, const std::string& word, std::string& value) {
  if (!line.starts_with(word)) return false;
  value = line.substr(word.size());
  return true;
}

Mistake mistake_in(const std::string& block) {
  Mistake mistake;
  mistake.as_read = block;
  std::istringstream lines(block);
  std::string value;
  for (std::string line; std::getline(lines, line);) {
    if (after(line, "## ", value)) {
      mistake.title = value;
    } else if (after(line, "% ", value)) {
      mistake.before.push_back(value);
    } else if (after(line, "$ ", value)) {
      mistake.command = value;
    } else if (line.starts_with("- ")) {
      for (const char* part : kParts)
        if (after(line, text("- ", part, ": "), value)) mistake.parts[part] = value;
    } else {
      mistake.wanted += line + "\n";
    }
  }
  return mistake;
}

/// What stands before the first case, and the cases.
std::pair<std::string, std::vector<Mistake>> mistakes() {
  std::istringstream lines(content_of(golden()));
  std::string head, block;
  std::vector<Mistake> all;
  for (std::string line; std::getline(lines, line);) {
    if (line.starts_with("## "))
      block = line + "\n";
    else if (block.empty())
      head += line + "\n";
    else if (!line.empty())
      block += line + "\n";
    else
      all.push_back(mistake_in(std::exchange(block, "")));
  }
  if (!block.empty()) all.push_back(mistake_in(block));
  return {head, all};
}

/// Where the commands are typed: photos in fox, a log in street, and runs on them.
const fs::path& desk() {
  static const fs::path folder = [] {
    const fs::path made = scratch() / "desk";
    fs::create_directories(made / "runs");
    write_synthetic_scene(made / "fox", {.train = 8, .test = 2, .size = 24});
    fs::copy(small_street(), made / "street", fs::copy_options::recursive);
    fs::copy(small_run(), made / "runs/fox", fs::copy_options::recursive);
    fs::remove_all(made / "runs/fox/eval");  // where another test evaluated it
    fs::copy(stopped_run(), made / "runs/stopped", fs::copy_options::recursive);
    fs::copy(small_street_run(), made / "runs/street", fs::copy_options::recursive);
    return made;
  }();
  return folder;
}

struct Answer {
  int code;
  std::string out, err;
};

Answer typed(const std::string& line) {
  const fs::path out = scratch() / "golden-out", err = scratch() / "golden-err";
  const std::string bin = fs::path(CLOAM_BINARY).parent_path().string();
  const std::string whole = "cd '" + desk().string() + "' && PATH='" + bin + "':$PATH && { " + line + "\n} >'" +
                            out.string() + "' 2>'" + err.string() + "'";
  const int status = std::system(whole.c_str());
  return {WEXITSTATUS(status), content_of(out), content_of(err)};
}

/// Places of this test and of this machine, as the file has them.
std::string as_anywhere(std::string said) {
  for (const auto& [place, word] : {std::pair{desk().string(), "HERE"}, {scratch().string(), "ELSEWHERE"}})
    for (std::size_t at; (at = said.find(place)) != std::string::npos;) said.replace(at, place.size(), word);
  return said;
}

/// <*> stands for what differs from machine to machine: anything but a line's end.
bool is_like(const std::string& said, const std::string& wanted) {
  std::string pattern;
  for (std::size_t i = 0; i < wanted.size(); ++i) {
    if (wanted.compare(i, 3, "<*>") == 0) {
      pattern += "[^\n]*";
      i += 2;
    } else {
      if (!std::isalnum(static_cast<unsigned char>(wanted[i])) && wanted[i] != '\n') pattern += '\\';
      pattern += wanted[i];
    }
  }
  return std::regex_match(said, std::regex(pattern));
}

std::string written_anew(const Mistake& mistake, const std::string& said) {
  std::string block = "## " + mistake.title + "\n";
  for (const std::string& line : mistake.before) block += "% " + line + "\n";
  block += "$ " + mistake.command + "\n" + (is_like(said, mistake.wanted) ? mistake.wanted : said);
  for (const char* part : kParts)
    if (mistake.parts.contains(part)) block += text("- ", part, ": ", mistake.parts.at(part), "\n");
  return block;
}

}  // namespace

TEST_CASE("golden errors: each mistake is told with what was looked for, what was found and what to do") {
  const auto [head, all] = mistakes();
  std::string anew = head;
  for (const Mistake& mistake : all) {
    CAPTURE(mistake.title);
    for (const std::string& line : mistake.before) CHECK_MESSAGE(typed(line).code == 0, line);
    const Answer answer = typed(mistake.command);
    const std::string said = as_anywhere(answer.err);
    anew += written_anew(mistake, said) + (&mistake == &all.back() ? "" : "\n");
    CHECK_MESSAGE(is_like(said, mistake.wanted), said);
    CHECK_MESSAGE(contains(said, text("[exit ", answer.code, "]")), answer.code);
    CHECK(answer.out.empty());
    for (const char* part : kParts) {
      const auto words = mistake.parts.find(part);
      CHECK_MESSAGE((words != mistake.parts.end() && contains(mistake.wanted, words->second)), part);
    }
  }
  CHECK(all.size() >= 40);
  if (std::getenv("CLOAM_WRITE_GOLDEN")) write_text(golden(), anew);
}
