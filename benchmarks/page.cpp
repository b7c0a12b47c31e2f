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
## Steps of Gaussians, by kernel

Not of this run: `train --profile` of 240x135 pixels and 39,307 Gaussians, two runs of 160 steps of each method, on an Intel
Xeon with AVX-512 that others used, too. Kernels that take more than a tenth of a step of either, as shares of `splat`'s device
time and of `street-gaussians`' step.

| kernel | `splat` | `street-gaussians` | why |
| --- | --- | --- | --- |
| `gradient_rows` | 27 to 28 % | 17 to 20 % | each pair of a Gaussian and a tile visits up to 16 rows of 16 pixels, an exponential and some 40 operations each; 0.9 GB/s or less, so memory is not what it waits for |
| `blend_rows` | 15 % | 6 to 7 % | the same visits, with half the operations |

What they reach of the peak of arithmetic is not counted: how many rows are visited follows from the data. `street-gaussians` waits
17 % of a step for the host, `splat` 10 %. A step of `neurad` was not profiled.

## How it is measured

- Ours and its peers take turns within one run: a pause of 60 ms (threads of other libraries spin for some 25 ms after their
  work and would take a core), one sample, the next program. A sample is as many runs back to back as last 20 ms. Nine
  rounds, five where a round takes longer than a second; the figures are medians.
- A peer is a program of its own with the environment that serves it best (above): one thread a core; threads held to cores for
  oneDNN and libtorch, not for OpenBLAS, which that halves; a malloc that keeps its memory, without which first touches of
  fresh pages cost libtorch up to ten times the work itself. `torch+passive` is libtorch with threads that sleep at once: its
  products run on OpenBLAS' threads, the rest on libgomp's, and each pool disturbs the other by spinning. Both take part and
  the faster counts, as do NCHW and `@channels_last`. A way of a peer with a floor of its own (`NAME@way`) has its own row.
- Peers compute what ours computes: outputs and gradients of products, convolutions, the fused MLP, group norm, attention,
  tri-planes, Adam and bias + ReLU were compared on equal inputs and agree to 5e-6 of their mean magnitude. In the decoder's
  step ours folds the doubling of images into the convolution after it (4 multiply-adds where the plain graph takes 9).
- **ratio** is the peer's time over ours. **floor** is the least that is acceptable, **reach** what is aimed at. **ratio at
  our peak** is what it would be if ours ran at the device's measured peak: no kernel gets beyond.
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

std::string rate_in_words(const BenchRow& row) {
  if (row.flops > 0) return fixed(row.gflops(), 0) + " GFLOP/s";
  return row.bytes > 0 ? fixed(row.gbps(), 1) + " GB/s" : "";
}

std::string share(const BenchRow& row, const DeviceLimits& limits) {
  const double value = row.share(limits);
  return value > 0 ? fixed(100 * value, 0) + " %" : "";
}

using Cells = std::vector<std::string>;

std::string line(const Cells& cells) {
  std::string out = "|";
  for (const std::string& cell : cells) out += " " + cell + " |";
  return out + "\n";
}

std::string table(const std::string& title, const Cells& head) {
  return "\n## " + title + "\n\n" + line(head) + line(Cells(head.size(), "---"));
}

Cells with_peer(const BenchRow& row, const DeviceLimits& limits) {
  Cells out = {"`" + row.name + "`", milliseconds(row.ms), rate_in_words(row), share(row, limits), "", "", ""};
  if (row.peers.empty()) return out;
  out[4] = row.peers.front().name;
  out[5] = milliseconds(row.peers.front().ms);
  out[6] = fixed(row.ratio(), 2);
  return out;
}
const Cells kPeerHead = {"name", "ms", "rate", "share", "fastest peer", "ms", "ratio"};

enum class Verdict { below, met, reached, no_peer };

Verdict verdict(const BenchRow& row, const Floor& floor) {
  if (floor.milliseconds)
    return row.ms > floor.floor ? Verdict::below : row.ms <= floor.reach ? Verdict::reached : Verdict::met;
  if (row.peers.empty()) return Verdict::no_peer;
  return row.ratio() < floor.floor ? Verdict::below : row.ratio() >= floor.reach ? Verdict::reached : Verdict::met;
}

/// Of a row below its floor: what its ratio would be if ours ran at the device's peak, and every peer's ratio.
std::string shortfall(const BenchRow& row, const Floor& floor, const DeviceLimits& limits) {
  std::string peers;
  for (const PeerTime& peer : row.peers)
    peers += text(peers.empty() ? "" : ", ", peer.name, " ", fixed(peer.ms / row.ms, 2));
  const bool bound = row.flops > 0 && !row.peers.empty();
  return line({"`" + row.name + "`", text(floor.floor), bound ? fixed(row.ratio() / row.share(limits), 2) : "", peers});
}

std::string demanded(const BenchReport& report) {
  Cells head = kPeerHead;
  head.insert(head.end(), {"floor", "reach", ""});
  std::string out, below;
  int count = 0, met = 0;
  for (const BenchRow& row : report.rows) {
    const Floor* floor = floor_of(row.name);
    if (!floor) continue;
    const Verdict found = verdict(row, *floor);
    const char* const words[] = {"**below**", "", "reached", "no peer here"};
    const std::string unit = floor->milliseconds ? " ms" : "";
    Cells cells = with_peer(row, report.limits);
    cells.insert(cells.end(), {text(floor->floor, unit), text(floor->reach, unit), words[static_cast<int>(found)]});
    out += line(cells);
    count++;
    met += found == Verdict::met || found == Verdict::reached;
    if (found == Verdict::below) below += shortfall(row, *floor, report.limits);
  }
  out = table("Against peers", head) + out + text("\n", met, " of ", count, " rows stand above their floor.\n");
  if (below.empty()) return out;
  return out + table("Below the floor", {"name", "floor", "ratio at our peak", "ratios to every peer"}) + below;
}

/// Of what repeats thousands of times, the cost beside the kernels' time.
bool is_step(const BenchRow& row) {
  return row.name.find(".step") != std::string::npos || row.name.starts_with("pointwise.");
}

std::string steps(const BenchReport& report) {
  std::string out = table("Whole steps", {"name", "ms", "rate", "share", "host", "launches", "bytes allocated"});
  for (const BenchRow& row : report.rows)
    if (is_step(row))
      out += line({"`" + row.name + "`", milliseconds(row.ms), rate_in_words(row), share(row, report.limits),
                   fixed(100 * row.host_share, 1) + " %", fixed(row.launches, 0), fixed(row.bytes_allocated, 0)});
  return out;
}

std::string others(const BenchReport& report) {
  std::string out = table("Everything else", kPeerHead);
  for (const BenchRow& row : report.rows)
    if (!floor_of(row.name) && !is_step(row)) out += line(with_peer(row, report.limits));
  return out;
}

std::string machine(const BenchReport& report) {
  const char* affinity = std::getenv("POCL_AFFINITY");
  const DeviceLimits& limits = report.limits;
  std::string out = line({"", ""}) + line({"---", "---"}) +
                    line({"device", text(device().name, ", ", device().compute_units, " compute units")}) +
                    line({"driver", device().platform + " " + device().driver}) +
                    line({"kernels for", device().device_class == DeviceClass::cpu ? "CPUs" : "GPUs"}) +
                    line({"`POCL_AFFINITY`", affinity ? affinity : "not set"}) +
                    line({"fp32 peak", fixed(limits.gflops, 0) + " GFLOP/s"}) +
                    line({"copy in main memory", fixed(limits.copy_gbps, 0) + " GB/s"}) +
                    line({"read, changed and written in place", fixed(limits.in_place_gbps, 0) + " GB/s"}) +
                    line({"copy within the last cache", fixed(limits.copy_l3_gbps, 0) + " GB/s"}) +
                    line({"copy within the cores' caches", fixed(limits.copy_l2_gbps, 0) + " GB/s"}) +
                    line({"launch", fixed(limits.launch_us, 1) + " us"}) +
                    line({"launch and wait", fixed(limits.round_trip_us, 0) + " us"});
  for (const auto& peer : report.peers) {
    std::string set;
    for (const std::string& variable : peer.environment) set += " `" + variable + "`";
    out += line({"peer " + peer.name, peer.library + ";" + set});
  }
  return out;
}

std::string growth(const std::vector<Series>& all, const std::string& plot) {
  if (all.empty()) return "";
  std::string out =
      text("\n## Cost over size\n\n![time each over size](", plot, ")\n\n| series | size: ns each |\n|---|---|\n");
  for (const Series& series : all) {
    out += "| `" + series.name + "`, N " + series.unit + " |";
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
  return kHead + machine(report) + demanded(report) + steps(report) + others(report) +
         growth(series_of(report.rows), plot) + (notes.empty() ? "" : "\n## Not measured\n\n" + notes) + kHow;
}

}  // namespace cloam
