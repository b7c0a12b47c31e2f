// The JSON Schemas of schemas/, embedded: what --json of each command prints and what the files of runs hold.
#pragma once
#include <string>
#include <vector>

namespace cloam {

std::vector<std::string> schema_names();
/// Its text. Fault::usage for an unknown name, with the nearest one.
std::string schema_named(const std::string& name);

}  // namespace cloam
