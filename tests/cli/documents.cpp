#include "tests/cli/documents.h"

#include <algorithm>

namespace cloam {
namespace fs = std::filesystem;

std::vector<fs::path> documents() {
  const fs::path source = CLOAM_SOURCE;
  std::vector<fs::path> files = {source / "README.md", source / "CONTRIBUTING.md"};
  for (const auto& entry : fs::recursive_directory_iterator(source / "docs"))
    if (entry.path().extension() == ".md") files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  return files;
}

bool comes_from_elsewhere(const fs::path& document) { return document.parent_path().filename() == "coming-from"; }

std::string without_first_cell(const std::string& line) {
  return line.starts_with("| ") ? line.substr(std::min(line.find('|', 1), line.size())) : line;
}

}  // namespace cloam
