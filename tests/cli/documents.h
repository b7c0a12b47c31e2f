// The documents of the project as the tests read them.
#pragma once
#include <filesystem>
#include <string>
#include <vector>

namespace cloam {

/// README.md, CONTRIBUTING.md and every page of docs/, sorted.
std::vector<std::filesystem::path> documents();
/// A page for people who know another program, whose commands stand in the first cell of its tables.
bool comes_from_elsewhere(const std::filesystem::path& document);
/// A line of such a page without that cell; other lines as they are.
std::string without_first_cell(const std::string& line);

}  // namespace cloam
