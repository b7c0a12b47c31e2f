// See path_file.h.
#include "models/data/path_file.h"

#include <cmath>
#include <nlohmann/json.hpp>
#include <sstream>

#include "models/io/bytes.h"
#include "models/io/json.h"
#include "models/io/safetensors_header.h"  // printable
#include "models/io/words.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr char kHead[] = "time,x,y,z,yaw";
constexpr std::uint64_t kLargest = 64 << 20;
constexpr double kFarthestOfPath = 1e7;  // metres, as poses of all sources

PathPoint point(const std::array<double, 5>& v, const std::string& where) {
  const bool near =
      std::abs(v[1]) < kFarthestOfPath && std::abs(v[2]) < kFarthestOfPath && std::abs(v[3]) < kFarthestOfPath;
  if (near) return {v[0], {v[1], v[2], v[3]}, v[4]};
  bad_data(where, ": the position ", v[1], ", ", v[2], ", ", v[3], " is beyond ", kFarthestOfPath, " m");
}

PathPoint point_of_line(const std::string& line, const std::string& where) {
  std::array<double, 5> values{};
  std::string_view rest = line;
  for (std::size_t i = 0; i < values.size(); ++i) {
    rest.remove_prefix(std::min(rest.find_first_not_of(' '), rest.size()));
    const std::size_t end = i + 1 == values.size() ? rest.size() : rest.find(',');
    const auto value = number_in<double>(rest.substr(0, end));
    if (end == std::string_view::npos || !value || !std::isfinite(*value))
      bad_data(where, ": want five numbers (", kHead, "), found: ", printable(line));
    values[i] = *value;
    rest.remove_prefix(std::min(end + 1, rest.size()));
  }
  return point(values, where);
}

std::vector<PathPoint> read_csv(const std::string& content, const std::string& name) {
  std::istringstream lines(content);
  std::vector<PathPoint> path;
  std::string line;
  for (int row = 1; std::getline(lines, line); ++row) {
    while (!line.empty() && (line.back() == '\r' || line.back() == ' ')) line.pop_back();
    const std::string where = text(name, ", line ", row);
    if (row == 1 && line != kHead)
      bad_data(where, ": want the header line ", kHead, " (or a JSON list), found: ", printable(line));
    if (row > 1 && !line.empty()) path.push_back(point_of_line(line, where));
  }
  return path;
}

std::vector<PathPoint> read_json_path(const std::string& content, const std::string& name) {
  const Json json = parse_json(content, name);
  if (!json.is_array()) bad_data(name + ": want a list of points with time, x, y, z, yaw");
  std::vector<PathPoint> path;
  for (const Json& entry : json) {
    const std::string where = text(name, ", point ", path.size());
    std::array<double, 5> values{};
    const char* const keys[] = {"time", "x", "y", "z", "yaw"};
    for (std::size_t i = 0; i < values.size(); ++i) values[i] = number(entry, keys[i], where);
    path.push_back(point(values, where));
  }
  return path;
}

}  // namespace

std::vector<PathPoint> read_path_file(const std::filesystem::path& path) {
  const std::vector<std::uint8_t> bytes = read_file(path, kLargest);
  const std::string content(bytes.begin(), bytes.end()), name = path.string();
  const std::size_t first = content.find_first_not_of(" \t\r\n");
  const bool is_json = first != std::string::npos && (content[first] == '[' || content[first] == '{');
  std::vector<PathPoint> points = is_json ? read_json_path(content, name) : read_csv(content, name);
  if (points.empty()) bad_data(name + ": the path has no points");
  return points;
}

}  // namespace cloam
