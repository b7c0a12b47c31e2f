// The floors of models/: what the build enforces (CMakeLists.txt, floor()), read from the includes themselves, so that
// a tie is printed with the files that make it.
#include <doctest/doctest.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <set>
#include <string>

namespace fs = std::filesystem;

namespace {

/// By folder and the folder that it includes: "from.h includes models/to/header.h", a line each.
using Ties = std::map<std::string, std::map<std::string, std::string>>;

Ties ties_of(const fs::path& models) {
  Ties ties;
  const std::regex include("^#include \"models/([a-z]+)/([a-z_0-9]+\\.h)\"");
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(models)) {
    if (!entry.is_regular_file()) continue;
    const std::string folder = fs::relative(entry.path(), models).begin()->string();
    std::ifstream file(entry.path());
    std::smatch found;
    for (std::string line; std::getline(file, line);)
      if (std::regex_search(line, found, include) && found[1] != folder)
        ties[folder][found[1]] += "\n  " + folder + "/" + entry.path().filename().string() + " includes " +
                                  found[1].str() + "/" + found[2].str();
  }
  return ties;
}

/// All that a folder reaches by includes, over as many others as it takes.
void reach(const Ties& ties, const std::string& from, std::set<std::string>& reached) {
  const auto found = ties.find(from);
  if (found == ties.end()) return;
  for (const auto& [to, files] : found->second)
    if (reached.insert(to).second) reach(ties, to, reached);
}

}  // namespace

TEST_CASE("no folder of models/ includes one that includes it, directly or over others") {
  const Ties ties = ties_of(fs::path(CLOAM_SOURCES) / "models");
  CHECK(ties.size() > 10);
  for (const auto& [from, others] : ties)
    for (const auto& [to, files] : others) {
      std::set<std::string> back;
      reach(ties, to, back);
      INFO("models/", from, " and models/", to, " include each other:", files,
           ties.contains(to) && ties.at(to).contains(from) ? ties.at(to).at(from) : "\n  (back over other folders)");
      CHECK(!back.contains(from));
    }
}

TEST_CASE("nothing below cli/ includes it, and runtime/ includes no models/") {
  for (const char* folder : {"models", "runtime"})
    for (const fs::directory_entry& entry : fs::recursive_directory_iterator(fs::path(CLOAM_SOURCES) / folder)) {
      if (!entry.is_regular_file()) continue;
      std::ifstream file(entry.path());
      for (std::string line; std::getline(file, line);) {
        INFO(entry.path().string(), ": ", line);
        CHECK(!line.starts_with("#include \"cli/"));
        if (std::string(folder) == "runtime") CHECK(!line.starts_with("#include \"models/"));
      }
    }
}

// Two types of one name and namespace in the program are one to the linker, which keeps the member functions of either:
// the program then destroys the one by the other's destructor. No tool that we have says it.
TEST_CASE("no two headers define a type of the same name") {
  const std::regex type("^(struct|class|enum class|enum|union) ([A-Za-z]+)( final)?( :.*)? \\{.*");
  std::map<std::string, std::string> defined;
  for (const char* folder : {"runtime", "models", "cli", "tests/op_cases", "benchmarks/steps", "benchmarks/workloads"})
    for (const fs::directory_entry& entry : fs::recursive_directory_iterator(fs::path(CLOAM_SOURCES) / folder)) {
      if (entry.path().extension() != ".h") continue;
      std::ifstream file(entry.path());
      std::smatch found;
      for (std::string line; std::getline(file, line);) {
        if (!std::regex_match(line, found, type)) continue;
        const auto [before, is_new] = defined.try_emplace(found[2], entry.path().string());
        CHECK_MESSAGE(is_new, found[2].str() << " is defined in " << before->second << " and in "
                                             << entry.path().string() << ": one of them needs another name");
      }
    }
  CHECK(defined.size() > 300);
}
