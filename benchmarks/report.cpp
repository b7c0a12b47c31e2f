// The table and the JSON of a benchmark run.
#include "benchmarks/report.h"

#include <cmath>
#include <cstdio>
#include <cstdlib>

#include "benchmarks/floors.h"
#include "runtime/device.h"
#include "runtime/error.h"

namespace cloam {
namespace {

std::string quoted(const std::string& words) {
  std::string out = "\"";
  for (char c : words) {
    if (c == '"' || c == '\\') out += '\\';
    out += static_cast<unsigned char>(c) < 32 ? ' ' : c;
  }
  return out + "\"";
}

/// Six digits; null for what is not there.
std::string number(double value) {
  char buffer[32];
  std::snprintf(buffer, sizeof buffer, "%.6g", value);
  return std::isfinite(value) && value != 0 ? buffer : "null";
}

std::string object_of(const std::vector<PeerTime>& peers) {
  std::string out;
  for (const PeerTime& peer : peers) out += (out.empty() ? "" : ", ") + quoted(peer.name) + ": " + number(peer.ms);
  return "{" + out + "}";
}

std::string object_of(const BenchRow& row, const DeviceLimits& limits) {
  const Floor* floor = floor_of(row.name);
  const bool met = !row.peers.empty();
  return text("{\"name\": ", quoted(row.name), ", \"median_ms\": ", number(row.ms),
              ", \"gflops\": ", number(row.gflops()), ", \"gbps\": ", number(row.gbps()),
              ", \"share_of_peak\": ", number(row.share(limits)), ", \"variant\": ", quoted(row.variant),
              ", \"peer\": ", met ? quoted(row.peers.front().name) : "null",
              ", \"peer_median_ms\": ", met ? number(row.peers.front().ms) : "null",
              ", \"ratio\": ", number(row.ratio()), ", \"peers\": ", object_of(row.peers),
              ", \"floor\": ", floor ? number(floor->floor) : "null", ", \"host_share\": ", row.host_share,
              ", \"launches\": ", row.launches, ", \"bytes_allocated\": ", row.bytes_allocated, "}");
}

std::string padded(const std::string& words, int width) {
  char buffer[256];
  std::snprintf(buffer, sizeof buffer, "%-*s", width, words.c_str());
  return buffer;
}

/// "208.1 GFLOP/s" and the like.
std::string rate(const BenchRow& row) {
  char buffer[64] = "";
  if (row.flops > 0)
    std::snprintf(buffer, sizeof buffer, "%.1f GFLOP/s", row.gflops());
  else if (row.bytes > 0)
    std::snprintf(buffer, sizeof buffer, "%.1f GB/s", row.gbps());
  return buffer;
}

std::string line_of(const BenchRow& row, const DeviceLimits& limits) {
  char buffer[256];
  const double share = row.share(limits);
  std::snprintf(buffer, sizeof buffer, "%-40s %10.3f ms %16s %6s", row.name.c_str(), row.ms, rate(row).c_str(),
                share > 0 ? text(std::lround(100 * share), " %").c_str() : "");
  std::string out = buffer;
  if (row.peers.empty()) return out;
  std::snprintf(buffer, sizeof buffer, "   %-28s %10.3f ms %6.2f", row.peers.front().name.c_str(), row.peers.front().ms,
                row.ratio());
  return out + buffer;
}

}  // namespace

std::string table_of(const BenchReport& report) {
  const DeviceLimits& limits = report.limits;
  char buffer[256];
  std::snprintf(buffer, sizeof buffer, "peak %.0f GFLOP/s fp32, copy %.0f GB/s, launch %.1f us\n", limits.gflops,
                limits.copy_gbps, limits.launch_us);
  std::string out = device().name + " (" + device().driver + ")\n" + buffer + "\n" + padded("name", 40) +
                    "     median                rate  share   fastest peer                     median  ratio\n";
  for (const BenchRow& row : report.rows) out += line_of(row, limits) + "\n";
  return out;
}

std::string json_of(const BenchReport& report) {
  const char* affinity = std::getenv("POCL_AFFINITY");
  const DeviceLimits& limits = report.limits;
  std::string rows, notes, peers;
  for (const auto& peer : report.peers)
    peers += (peers.empty() ? "" : ", ") + quoted(peer.name) + ": " + quoted(peer.library);
  for (const BenchRow& row : report.rows) rows += (rows.empty() ? "\n  " : ",\n  ") + object_of(row, limits);
  for (const std::string& note : report.notes) notes += (notes.empty() ? "" : ", ") + quoted(note);
  return text("{\"schema_version\": 1, \"device\": ", quoted(device().name), ", \"driver\": ", quoted(device().driver),
              ", \"platform\": ", quoted(device().platform),
              ", \"class\": ", device().device_class == DeviceClass::cpu ? "\"cpu\"" : "\"gpu\"",
              ", \"compute_units\": ", device().compute_units,
              ", \"pocl_affinity\": ", affinity ? quoted(affinity) : "null",
              ",\n \"limits\": {\"gflops\": ", number(limits.gflops), ", \"copy_gbps\": ", number(limits.copy_gbps),
              ", \"in_place_gbps\": ", number(limits.in_place_gbps),
              ", \"copy_l3_gbps\": ", number(limits.copy_l3_gbps), ", \"copy_l2_gbps\": ", number(limits.copy_l2_gbps),
              ", \"launch_us\": ", number(limits.launch_us), ", \"round_trip_us\": ", number(limits.round_trip_us),
              "},\n \"peers\": {", peers, "},\n \"notes\": [", notes, "],\n \"rows\": [", rows, "\n]}\n");
}

}  // namespace cloam
