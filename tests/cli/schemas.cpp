// See schemas.h.
#include "tests/cli/schemas.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <sstream>
#include <valijson/adapters/nlohmann_json_adapter.hpp>
#include <valijson/schema.hpp>
#include <valijson/schema_parser.hpp>
#include <valijson/validation_results.hpp>
#include <valijson/validator.hpp>

namespace cloam {
namespace {

namespace fs = std::filesystem;
using Adapter = valijson::adapters::NlohmannJsonAdapter;

fs::path file_of(const std::string& name) { return fs::path(CLOAM_SOURCE) / "schemas" / (name + ".schema.json"); }

const valijson::Schema& schema_of(const std::string& name) {
  static std::map<std::string, valijson::Schema> known;
  const auto [found, is_new] = known.try_emplace(name);
  if (is_new) {
    const nlohmann::json json = json_of(file_of(name));
    valijson::SchemaParser(valijson::SchemaParser::kDraft7).populateSchema(Adapter(json), found->second);
  }
  return found->second;
}

bool has_word(const Words& words, const std::string& word) {
  return std::find(words.begin(), words.end(), word) != words.end();
}

void check(const std::string& schema, const std::string& text) {
  const nlohmann::json json = nlohmann::json::parse(text, nullptr, false);
  REQUIRE_MESSAGE(!json.is_discarded(), text);
  const std::string problems = problems_by_schema(schema, json);
  CHECK_MESSAGE(problems.empty(), schema << ": " << problems << "in " << text.substr(0, 2000));
}

void check_lines(const std::string& schema, const std::string& text) {
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) check(schema, line);
}

/// The run folder of a training; nothing where it is told by --resume or chosen by the program.
fs::path run_of(const Words& words) {
  for (std::size_t i = 0; i + 1 < words.size(); ++i)
    if (words[i] == "-o") return words[i + 1];
  return {};
}

}  // namespace

std::string problems_by_schema(const std::string& name, const nlohmann::json& json) {
  if (!fs::exists(file_of(name))) return "there is no schemas/" + name + ".schema.json\n";
  valijson::ValidationResults results;
  valijson::Validator validator;
  if (validator.validate(schema_of(name), Adapter(json), &results)) return "";
  std::string problems;
  for (valijson::ValidationResults::Error error; results.popError(error);) {
    for (const std::string& place : error.context) problems += place;
    problems += ": " + error.description + "\n";
  }
  return problems;
}

void check_by_schemas(const Words& arguments, const Outcome& outcome) {
  if (outcome.code != 0 || arguments.empty()) return;
  const std::string& command = arguments.front();
  if (command == "train") {
    if (has_word(arguments, "--json") || has_word(arguments, "jsonl")) check_lines("events", outcome.out);
    const fs::path run = run_of(arguments);
    if (run.empty() || has_word(arguments, "--dry-run") || !fs::exists(run / "run.json")) return;
    check("run", content_of(run / "run.json"));
    check("scene", content_of(run / "scene.json"));
    check_lines("events", content_of(run / "metrics.jsonl"));
  } else if (has_word(arguments, "--json") && !outcome.out.empty()) {
    check(command, outcome.out);
  }
}

}  // namespace cloam
