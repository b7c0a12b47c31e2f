// What the program prints with --json and writes as JSON, held to the schemas of schemas/: whatever a test runs.
#pragma once
#include "tests/cli/process.h"

namespace cloam {

/// What is wrong with JSON by the schema of that name, a line each; "" for nothing. A schema that does not exist is
/// wrong.
std::string problems_by_schema(const std::string& name, const nlohmann::json& json);

/// Fails the test if the output of a command that ended well is not as its schema says: the object that --json prints,
/// the events of a training, and what lies in the run folder that -o names.
void check_by_schemas(const Words& arguments, const Outcome& outcome);

}  // namespace cloam
