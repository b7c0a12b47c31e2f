// The schemas and stored outputs of each of their versions (fixtures/NAME.vN.json): what programs read today, they must
// be able to read of tomorrow's and yesterday's cloam. What the program prints today is checked wherever a test runs it
// (schemas.h).
#include "tests/cli/schemas.h"

#include <doctest/doctest.h>

#include <nlohmann/json.hpp>
#include <set>
#include <sstream>

#include "tests/cli/process.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

fs::path fixtures() { return fs::path(CLOAM_SOURCE) / "tests/cli/fixtures"; }

/// Name and version of NAME.vN.json, NAME.vNb.json (another kind of output) and NAME.vN.jsonl.
std::pair<std::string, int> named(const fs::path& file) {
  const std::string stem = file.stem().string();
  const std::size_t dot = stem.find(".v");
  return {stem.substr(0, dot), std::stoi(stem.substr(dot + 2))};
}

std::vector<nlohmann::json> objects_of(const fs::path& file) {
  if (file.extension() == ".json") return {json_of(file)};
  std::vector<nlohmann::json> objects;
  std::istringstream lines(content_of(file));
  for (std::string line; std::getline(lines, line);) objects.push_back(nlohmann::json::parse(line));
  return objects;
}

/// Every place in a schema that states versions.
std::set<int> versions_in(const nlohmann::json& schema) {
  std::set<int> versions;
  if (schema.is_object() && schema.contains("properties") && schema["properties"].contains("schema_version"))
    for (const auto& version : schema["properties"]["schema_version"].value("enum", nlohmann::json::array()))
      versions.insert(version.get<int>());
  for (const char* kind : {"oneOf", "anyOf"})
    if (schema.contains(kind))
      for (const auto& part : schema[kind]) versions.merge(versions_in(part));
  return versions;
}

Words schema_names() {
  std::istringstream lines(cloam_with({"config", "schema"}).out);
  Words names;
  for (std::string name; std::getline(lines, name);) names.push_back(name);
  return names;
}

}  // namespace

TEST_CASE("schemas: outputs of every version are stored, and are as their schema says") {
  std::map<std::string, std::set<int>> stored;
  for (const auto& entry : fs::directory_iterator(fixtures())) {
    CAPTURE(entry.path());
    const auto [name, version] = named(entry.path());
    stored[name].insert(version);
    for (const nlohmann::json& json : objects_of(entry.path())) {
      CHECK(problems_by_schema(name, json) == "");
      CHECK(json.at("schema_version") == version);
    }
  }
  const Words names = schema_names();
  CHECK(names.size() >= 25);
  for (const std::string& name : names) {
    CAPTURE(name);
    const Outcome shown = cloam_with({"config", "schema", name});
    REQUIRE_MESSAGE(shown.code == 0, shown.err);
    CHECK(stored[name] == versions_in(nlohmann::json::parse(shown.out)));
  }
}

TEST_CASE("schemas: what is missing, of another kind or of a version that nobody knows is found") {
  for (const auto& entry : fs::directory_iterator(fixtures())) {
    CAPTURE(entry.path());
    const std::string name = named(entry.path()).first;
    for (const nlohmann::json& json : objects_of(entry.path())) {
      nlohmann::json without = json, later = json, word = json;
      without.erase("schema_version");
      later["schema_version"] = 99;
      CHECK(problems_by_schema(name, without) != "");
      CHECK(problems_by_schema(name, later) != "");
      for (auto& [key, value] : word.items())
        if (value.is_number()) value = "a word";
      CHECK(problems_by_schema(name, word) != "");
    }
  }
}

TEST_CASE("schemas: every command with --json has one") {
  const Words names = schema_names();
  const std::set<std::string> known(names.begin(), names.end());
  for (const char* command : {"eval",     "compare",  "tables",   "distance", "crops",  "render", "export", "convert",
                              "generate", "edit",     "simulate", "process",  "check",  "demo",   "synth",  "info",
                              "doctor",   "selftest", "bench",    "tune",     "config", "view",   "report"})
    CHECK_MESSAGE(known.contains(command), command);
  CHECK(known.contains("events"));  // cloam train --json
}

TEST_CASE(
    "schemas: files of earlier versions are read: records of runs by config, figures of devices by bench --merge") {
  for (const char* version : {"v1", "v2"}) {
    const fs::path run = scratch() / (std::string("run-of-") + version);
    fs::create_directories(run);
    fs::copy_file(fixtures() / (std::string("run.") + version + ".json"), run / "run.json");
    const Outcome shown = cloam_with({"config", "show", run.string()});
    REQUIRE_MESSAGE(shown.code == 0, shown.err);
    CHECK(contains(shown.out, "batch.rays = 64"));
  }
  const Outcome same =
      cloam_with({"config", "diff", (scratch() / "run-of-v1").string(), (scratch() / "run-of-v2").string(), "--json"});
  for (const auto& difference : nlohmann::json::parse(same.out).at("differences"))
    CHECK(difference.at("key") == "actors");  // version 1 had all, and no word for it
  const Outcome merged = cloam_with({"bench", "--merge", (fixtures() / "bench.v1.json").string()});
  REQUIRE_MESSAGE(merged.code == 0, merged.err);
  CHECK(contains(merged.out, "matmul.512.nn"));
}
