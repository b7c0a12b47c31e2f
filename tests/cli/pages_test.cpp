// What a reader finds in README.md and docs/: answers at once, links that lead somewhere, pictures that load quickly.
#include <doctest/doctest.h>

#include <algorithm>
#include <cctype>
#include <regex>
#include <set>
#include <sstream>

#include "models/io/image.h"
#include "models/methods/registry.h"
#include "tests/cli/documents.h"
#include "tests/cli/process.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

const fs::path kSource = CLOAM_SOURCE;

/// Without what stands between fences.
std::string prose_of(const fs::path& page) {
  std::istringstream text(content_of(page));
  std::string prose;
  bool fenced = false;
  for (std::string line; std::getline(text, line);) {
    if (line.starts_with("```"))
      fenced = !fenced;
    else if (!fenced)
      prose += line + "\n";
  }
  return prose;
}

/// "How fast?" -> "how-fast", as GitHub names the places of headings.
std::string place_of(const std::string& heading) {
  std::string place;
  for (const char c : heading) {
    const auto byte = static_cast<unsigned char>(c);
    if (std::isalnum(byte) || c == '-' || c == '_' || byte >= 128) place += static_cast<char>(std::tolower(byte));
    if (c == ' ') place += '-';
  }
  return place;
}

std::set<std::string> places_in(const fs::path& page) {
  std::istringstream text(prose_of(page));
  std::set<std::string> places;
  for (std::string line; std::getline(text, line);)
    if (line.starts_with("#")) places.insert(place_of(line.substr(line.find_first_not_of('#') + 1)));
  return places;
}

struct Link {
  bool picture;
  std::string target;
};

std::vector<Link> links_in(const fs::path& page) {
  static const std::regex link("(!?)\\[[^\\]]*\\]\\(([^)\\s]+)\\)");
  const std::string prose = std::regex_replace(prose_of(page), std::regex("`[^`\n]*`"), "code");
  std::vector<Link> links;
  for (std::sregex_iterator match(prose.begin(), prose.end(), link), end; match != end; ++match)
    links.push_back({(*match)[1].length() > 0, (*match)[2]});
  return links;
}

bool elsewhere(const Link& link) { return link.target.starts_with("http://") || link.target.starts_with("https://"); }

fs::path file_of(const fs::path& page, const Link& link) {
  const std::string name = link.target.substr(0, link.target.find('#'));
  return name.empty() ? page : (page.parent_path() / name).lexically_normal();
}

}  // namespace

TEST_CASE("every relative link of the documents leads to a file and to a heading in it") {
  int checked = 0;
  for (const fs::path& page : documents())
    for (const Link& link : links_in(page)) {
      if (elsewhere(link)) continue;
      CAPTURE(page.string());
      const fs::path file = file_of(page, link);
      CHECK_MESSAGE(fs::exists(file), link.target);
      const std::size_t hash = link.target.find('#');
      if (hash != std::string::npos && file.extension() == ".md")
        CHECK_MESSAGE(places_in(file).contains(link.target.substr(hash + 1)), link.target);
      ++checked;
    }
  CHECK(checked > 80);
}

TEST_CASE("pictures of the documents are read, small, and all used") {
  std::set<fs::path> used;
  for (const fs::path& page : documents())
    for (const Link& link : links_in(page)) {
      if (!link.picture || elsewhere(link)) continue;
      const fs::path file = file_of(page, link);
      used.insert(file);
      CAPTURE(file.string());
      if (!fs::exists(file)) continue;  // told above
      const bool moves = file.extension() == ".gif";
      CHECK(fs::file_size(file) <= (moves ? 1536u : 150u) * 1024);
      const std::string bytes = content_of(file).substr(0, 6);
      if (moves) CHECK(bytes == "GIF89a");
      if (file.extension() == ".jpg") CHECK(read_image_size(file).width > 0);
    }
  for (const auto& entry : fs::directory_iterator(kSource / "docs/pictures"))
    CHECK_MESSAGE(used.contains(entry.path()), entry.path().string() << " is on no page");
}

TEST_CASE("README's first 120 lines answer what people come with") {
  std::istringstream text(content_of(kSource / "README.md"));
  std::string first;
  std::vector<std::string> lines;
  for (std::string line; std::getline(text, line); lines.push_back(line))
    if (lines.size() < 120) first += line + "\n";
  CHECK(lines.size() <= 240);
  const std::vector<std::vector<std::string>> answers = {
      {"AMD", "RUSTICL_ENABLE=radeonsi", "mesa-opencl-icd", "rocm-opencl-icd", "nobody has run it", "cloam doctor",
       "cloam selftest --quick"},
      {"phone", "ffmpeg", "cloam process", "cloam train splat", "cloam export"},
      {"OpenSplat", "dB", "docs/coming-from/opensplat.md"},
      {"KITTI", "cloam train genassets KITTI", "replace=generated", "cloam simulate"},
      {"without a GPU", "pocl-opencl-icd", "oclgrind", "docs/testing-without-a-gpu.md"},
      {"add a method", "CONTRIBUTING.md#adding-a-method"},
      {"docs/pictures/", "script/demo"}};
  for (const auto& words : answers)
    for (const std::string& word : words) CHECK_MESSAGE(contains(first, word), word);
}

TEST_CASE("docs/README.md leads to every page, and every method has one of 1,500 words at most") {
  const fs::path index = kSource / "docs/README.md";
  std::set<fs::path> linked = {index, kSource / "README.md"};
  for (const Link& link : links_in(index))
    if (!elsewhere(link)) linked.insert(file_of(index, link));
  for (const fs::path& page : documents()) CHECK_MESSAGE(linked.contains(page), page.string());
  for (const std::string& method : method_names()) {
    std::istringstream text(content_of(kSource / "docs/methods" / (method + ".md")));
    int words = 0;
    for (std::string word; text >> word;) ++words;
    CAPTURE(method);
    CHECK(words > 100);
    CHECK(words <= 1500);
  }
}
