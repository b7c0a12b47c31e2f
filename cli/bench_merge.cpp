// See bench_merge.h.
#include "cli/bench_merge.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

#include "models/io/json.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr int kSchema = 1;  // of `bench --json`

struct Timing {
  double ms = 0, share = 0;  // share of the device's peak; 0: not told
};

/// One file: a device and what was timed on it.
struct Bench {
  std::string name, driver, platform, device_class;
  double gflops = 0, copy_gbps = 0, launch_us = 0;
  std::vector<std::string> order = {};
  std::map<std::string, Timing> rows = {};
};

double number_at(const Json& object, const char* key) {
  const auto found = object.find(key);
  return found != object.end() && found->is_number() ? found->get<double>() : 0;
}

std::string word_at(const Json& object, const char* key) {
  const auto found = object.find(key);
  return found != object.end() && found->is_string() ? found->get<std::string>() : "";
}

Bench read_bench(const std::string& file) {
  const Json json = parse_json_file(file);
  if (!json.is_object() || !json.contains("rows") || !json["rows"].is_array() || word_at(json, "device").empty())
    bad_data(file, ": want an object with \"device\" and \"rows\", as cloam bench --json writes");
  if (number_at(json, "schema_version") != kSchema)
    bad_data(file, ": schema_version is ", json.value("schema_version", Json()).dump(), ", want ", kSchema,
             "\n  fix: run cloam bench --json with this version");
  Bench out{word_at(json, "device"), word_at(json, "driver"), word_at(json, "platform"), word_at(json, "class")};
  const Json limits = json.value("limits", Json::object());
  out.gflops = number_at(limits, "gflops");
  out.copy_gbps = number_at(limits, "copy_gbps");
  out.launch_us = number_at(limits, "launch_us");
  for (const Json& row : json["rows"]) {
    const std::string name = row.is_object() ? word_at(row, "name") : "";
    const double ms = row.is_object() ? number_at(row, "median_ms") : 0;
    if (name.empty() || !(ms > 0)) bad_data(file, ": a row has no name or no median_ms above 0: ", row.dump());
    if (out.rows.emplace(name, Timing{ms, number_at(row, "share_of_peak")}).second) out.order.push_back(name);
  }
  return out;
}

/// The geometric mean of time of the first / time of this, over the workloads of both, and how many these are.
std::string speed_over(const Bench& first, const Bench& other) {
  double sum = 0;
  int count = 0;
  for (const auto& [name, timing] : other.rows) {
    const auto same = first.rows.find(name);
    if (same == first.rows.end()) continue;
    sum += std::log(same->second.ms / timing.ms);
    count++;
  }
  return count ? fmt::format("{:.2f} ({} workload{})", std::exp(sum / count), count, count == 1 ? "" : "s") : "-";
}

std::string cell(const Bench& bench, const std::string& workload) {
  const auto found = bench.rows.find(workload);
  if (found == bench.rows.end()) return "-";
  const std::string share =
      found->second.share > 0 ? fmt::format(", {:.0f} %", 100 * found->second.share) : std::string();
  return fmt::format("{:.4g} ms{}", found->second.ms, share);
}

std::string devices_table(const std::vector<Bench>& all) {
  std::string out =
      "| device | driver | platform | class | peak | copy | launch | speed over device 1 "
      "|\n|---|---|---|---|---|---|---|---|\n";
  for (size_t i = 0; i < all.size(); i++) {
    const Bench& b = all[i];
    out += fmt::format("| {}: {} | {} | {} | {} | {:.0f} GFLOP/s | {:.0f} GB/s | {:.1f} us | {} |\n", i + 1, b.name,
                       b.driver, b.platform, b.device_class, b.gflops, b.copy_gbps, b.launch_us,
                       i ? speed_over(all[0], b) : "1");
  }
  return out;
}

}  // namespace

std::string merged_page(const std::vector<std::string>& files) {
  std::vector<Bench> all;
  std::vector<std::string> workloads;
  for (const std::string& file : files) {
    all.push_back(read_bench(file));
    for (const std::string& name : all.back().order)
      if (std::find(workloads.begin(), workloads.end(), name) == workloads.end()) workloads.push_back(name);
  }
  if (all.empty()) throw Error(Fault::usage, "--merge: name the files that cloam bench --json wrote");
  std::string out = "# Devices compared\n\nMedians of one run, and the share of the device's own measured peak.\n\n" +
                    devices_table(all) + "\n| workload |";
  for (size_t i = 0; i < all.size(); i++) out += fmt::format(" {} |", i + 1);
  out += "\n|---|";
  for (size_t i = 0; i < all.size(); i++) out += "---|";
  for (const std::string& workload : workloads) {
    out += "\n| `" + workload + "` |";
    for (const Bench& bench : all) out += " " + cell(bench, workload) + " |";
  }
  return out + "\n";
}

}  // namespace cloam
