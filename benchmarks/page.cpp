// docs/performance.md, as a benchmark run writes it.
#include <cmath>
#include <cstdio>
#include <cstdlib>

#include "benchmarks/floors.h"
#include "benchmarks/peer_process.h"
#include "benchmarks/report.h"
#include "benchmarks/scaling.h"
#include "runtime/device.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr char kHead[] = R"(# Performance

Written by `script/benchmark` (`cloam bench --peers --report docs/performance.md`). Do not edit: run it again, on a machine
that does nothing else.

)";

constexpr char kHow[] = R"(
## How it is measured

- Ours and its peers take turns within one run: a pause of 60 ms (threads of other libraries spin for some 25 ms after their
  work and would take a core), one sample, the next program. A sample is as many runs back to back as last 20 ms. Nine
  rounds, five where a round takes longer than a second; the figures are medians.
- A peer is a program of its own with the environment that serves it best: one thread a core (`OMP_NUM_THREADS`,
  `OPENBLAS_NUM_THREADS`); threads held to cores for oneDNN and libtorch (`OMP_PROC_BIND=true OMP_PLACES=cores`), not for
  OpenBLAS, which that halves; a malloc that keeps its memory (`MALLOC_MMAP_MAX_=0
  MALLOC_TRIM_THRESHOLD_=8589934592`), without which first touches of fresh pages cost libtorch up to ten times the work
  itself. `torch+passive` is libtorch with `OMP_WAIT_POLICY=passive OPENBLAS_THREAD_TIMEOUT=4`: its products run on
  OpenBLAS' threads, the rest on libgomp's, and each pool disturbs the other by spinning. Both take part and the faster
  counts, as do NCHW and `@channels_last`. A way of a peer with a floor of its own (`NAME@way`) has its own row.
- **ratio** is the peer's time over ours. **floor** is the least that is acceptable, **reach** what is aimed at.
- **share** is the rate over this device's measured peak: of fused multiply-adds (two operations each) for rows with GFLOP/s,
  of copying arrays larger than any cache (bytes read and written) for rows with GB/s. Operations and bytes are those that the
  mathematics needs, not those that the kernels do; so a share can exceed 100 % where data stays in a cache, where writes
  pass it by, or where work is skipped.
- **host** is the part of the time in which the host was not waiting for the device; **allocated** is what was asked from
  the driver, both a run.
)";

std::string fixed(double value, int digits) {
  char buffer[48];
  std::snprintf(buffer, sizeof buffer, "%.*f", digits, value);
  return buffer;
}

/// Three digits.
std::string milliseconds(double ms) { return fixed(ms, ms < 10 ? 3 : ms < 100 ? 2 : 1); }

std::string rate(const BenchRow& row) {
  if (row.flops > 0) return fixed(row.gflops(), 0) + " GFLOP/s";
  return row.bytes > 0 ? fixed(row.gbps(), 1) + " GB/s" : "";
}

std::string share(const BenchRow& row, const DeviceLimits& limits) {
  const double value = row.share(limits);
  return value > 0 ? fixed(100 * value, 0) + " %" : "";
}

std::string verdict(const BenchRow& row, const Floor& floor) {
  if (floor.milliseconds) return row.ms > floor.floor ? "**below**" : row.ms <= floor.reach ? "reached" : "";
  if (row.peers.empty()) return "no peer here";
  return row.ratio() < floor.floor ? "**below**" : row.ratio() >= floor.reach ? "reached" : "";
}

std::string demanded_line(const BenchRow& row, const Floor& floor, const DeviceLimits& limits) {
  const bool met = !row.peers.empty();
  const std::string unit = floor.milliseconds ? " ms" : "";
  return text("| `", row.name, "` | ", milliseconds(row.ms), " | ", rate(row), " | ", share(row, limits), " | ",
              met ? row.peers.front().name : "", " | ", met ? milliseconds(row.peers.front().ms) : "", " | ",
              met ? fixed(row.ratio(), 2) : "", " | ", floor.floor, unit, " | ", floor.reach, unit, " | ",
              verdict(row, floor), " |\n");
}

std::string demanded(const BenchReport& report) {
  std::string out =
      "## Against peers\n\n| name | ms | rate | share | fastest peer | ms | ratio | floor | reach | |\n"
      "|---|---|---|---|---|---|---|---|---|---|\n";
  for (const BenchRow& row : report.rows)
    if (const Floor* floor = floor_of(row.name)) out += demanded_line(row, *floor, report.limits);
  return out;
}

std::string others(const BenchReport& report) {
  std::string out =
      "\n## Everything else\n\n| name | ms | rate | share | host | launches | allocated |\n"
      "|---|---|---|---|---|---|---|\n";
  for (const BenchRow& row : report.rows) {
    if (floor_of(row.name)) continue;
    out += text("| `", row.name, "` | ", milliseconds(row.ms), " | ", rate(row), " | ", share(row, report.limits),
                " | ", fixed(100 * row.host_share, 1), " % | ", fixed(row.launches, 0), " | ",
                fixed(row.bytes_allocated, 0), " |\n");
  }
  return out;
}

std::string machine(const DeviceLimits& limits) {
  const char* affinity = std::getenv("POCL_AFFINITY");
  return text("| | |\n|---|---|\n| device | ", device().name, ", ", device().compute_units,
              " compute units |\n| driver | ", device().platform, " ", device().driver, " |\n| kernels for | ",
              device().device_class == DeviceClass::cpu ? "CPUs" : "GPUs", " |\n| `POCL_AFFINITY` | ",
              affinity ? affinity : "not set", " |\n| fp32 peak | ", fixed(limits.gflops, 0), " GFLOP/s |\n| copy | ",
              fixed(limits.copy_gbps, 0), " GB/s |\n| launch | ", fixed(limits.launch_us, 1), " us |\n\n");
}

std::string growth(const std::vector<Series>& all, const std::string& plot) {
  if (all.empty()) return "";
  std::string out =
      text("\n## Cost over size\n\n![time each over size](", plot, ")\n\n| series | size: ns each |\n|---|---|\n");
  for (const Series& series : all) {
    out += "| `" + series.name + "` |";
    for (const Series::Point& p : series.points) out += text(" ", p.size, ": ", fixed(p.ns, p.ns < 100 ? 2 : 0), ";");
    out.back() = ' ';
    out += "|\n";
  }
  return out;
}

}  // namespace

std::string page_of(const BenchReport& report, const std::string& plot) {
  std::string notes;
  for (const std::string& note : report.notes) notes += "- " + note + "\n";
  return kHead + machine(report.limits) + demanded(report) + others(report) + growth(series_of(report.rows), plot) +
         (notes.empty() ? "" : "\n## Not measured\n\n" + notes) + kHow;
}

}  // namespace cloam
