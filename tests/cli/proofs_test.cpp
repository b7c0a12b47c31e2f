// docs/proofs.md names tests: they must exist, by file and name.
#include <doctest/doctest.h>

#include <regex>
#include <sstream>

#include "tests/cli/process.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

/// The file and the name of each test that a line names: `FILE` "NAME", "NAME"; a name without a file is in the last
/// one.
std::vector<std::pair<std::string, std::string>> tests_in(const std::string& line) {
  static const std::regex expression("`(tests/[a-z_/]+\\.cpp)`|\"([^\"]+)\"");
  std::vector<std::pair<std::string, std::string>> tests;
  std::string file;
  for (std::sregex_iterator match(line.begin(), line.end(), expression), end; match != end; ++match) {
    if ((*match)[1].matched)
      file = (*match)[1];
    else
      tests.emplace_back(file, (*match)[2]);
  }
  return tests;
}

}  // namespace

TEST_CASE("proofs: every test that docs/proofs.md names exists, and every row names one or says that there is none") {
  std::istringstream lines(content_of(fs::path(CLOAM_SOURCE) / "docs/proofs.md"));
  int rows = 0, named = 0;
  for (std::string line; std::getline(lines, line);) {
    if (!line.starts_with("| ") || line.ends_with("| proof |")) continue;
    CAPTURE(line);
    const auto tests = tests_in(line);
    CHECK((!tests.empty() || contains(line, "not yet")));
    for (const auto& [file, name] : tests)
      CHECK_MESSAGE(contains(content_of(fs::path(CLOAM_SOURCE) / file), "\"" + name + "\""), file << " " << name);
    ++rows;
    named += static_cast<int>(tests.size());
  }
  CHECK(rows > 45);
  CHECK(named > 60);
}
