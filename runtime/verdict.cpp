// See verdict.h. The file has a line a fact: "when", "rows", "failed ROW", "off FAMILY ROW".
#include "runtime/verdict.h"

#include <charconv>
#include <cstdio>
#include <fstream>

#include "runtime/cache_folder.h"
#include "runtime/cl.h"
#include "runtime/debug.h"
#include "runtime/hash.h"

namespace cloam {
namespace {

uint64_t hash_of_kernels() {
  uint64_t hash = fnv1a("");
  for (const std::string& stem : kernel_stems()) hash = fnv1a(kernel_text(stem), hash);
  return hash;
}

/// One line into the verdict; false for one that nobody of ours wrote.
bool read_line(const std::string& line, Verdict& into) {
  const size_t space = line.find(' ');
  const std::string key = line.substr(0, space), value = space == std::string::npos ? "" : line.substr(space + 1);
  if (key == "when") into.when = value;
  if (key == "mode") into.quick = value == "quick";
  if (key == "failed") into.failed.push_back(value);
  if (key == "rows") std::from_chars(value.data(), value.data() + value.size(), into.rows);
  if (key == "off") into.off.push_back({value.substr(0, value.find(' ')), value.substr(value.find(' ') + 1)});
  return key == "#" || key == "when" || key == "mode" || key == "failed" || key == "rows" || key == "off";
}

}  // namespace

std::string verdict_file(const DeviceInfo& device) {
  const char* device_class = debug().float64 ? "float64" : device.device_class == DeviceClass::cpu ? "cpu" : "gpu";
  const uint64_t hash =
      fnv1a(text(device.platform, '|', device.name, '|', device.driver, '|', device_class), hash_of_kernels());
  char name[40];
  std::snprintf(name, sizeof name, "/verdict-%016llx.txt", static_cast<unsigned long long>(hash));
  return cache_folder() + name;
}

std::optional<Verdict> verdict_of(const DeviceInfo& device) {
  std::ifstream file(verdict_file(device));
  Verdict out;
  for (std::string line; std::getline(file, line);)
    if (!read_line(line, out)) return std::nullopt;
  if (out.when.empty() || out.rows <= 0) return std::nullopt;
  return out;
}

std::string file_text(const Verdict& verdict, const DeviceInfo& device) {
  std::string out = text("# ", device.name, ", driver ", device.driver, ": written by selftest; delete it to forget\n");
  out += text("when ", verdict.when, "\nmode ", verdict.quick ? "quick" : "full", "\nrows ", verdict.rows, "\n");
  for (const std::string& row : verdict.failed) out += text("failed ", row, "\n");
  for (const SwitchedOff& off : verdict.off) out += text("off ", off.family, ' ', off.op_row, "\n");
  return out;
}

std::string words_of(const std::optional<Verdict>& verdict) {
  if (!verdict) return "never tested";
  const std::string of = text(" selftest", verdict->quick ? " --quick" : "", " on ", verdict->when.substr(0, 10));
  if (!verdict->passed()) return text("failed ", verdict->failed.size(), " of ", verdict->rows, " rows of", of);
  if (verdict->off.empty()) return "passed" + of;
  return text("passed", of, ", ", verdict->off.size(), verdict->off.size() == 1 ? " kernel family" : " kernel families",
              " switched off");
}

}  // namespace cloam
