// See bench.h.
#include "benchmarks/bench.h"

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <thread>

#include "benchmarks/floors.h"
#include "benchmarks/measure.h"
#include "benchmarks/peer_process.h"
#include "runtime/device.h"
#include "runtime/error.h"
#include "runtime/variant.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

/// Threads of OpenBLAS and libgomp spin for some 25 ms after their work and would take a core from what runs next.
constexpr std::chrono::milliseconds kPause{60};

/// The folder of the peers' programs: that of our own, or $CLOAM_PEERS.
fs::path peer_folder() {
  if (const char* folder = std::getenv("CLOAM_PEERS")) return folder;
  return fs::read_symlink("/proc/self/exe").parent_path();
}

/// All peers that are here, started when first asked.
class Peers {
 public:
  explicit Peers(BenchReport& report) : report_(report) {
    for (const PeerProgram& program : peer_programs()) all_.push_back({program, nullptr, {}});
  }

  struct Contender {
    std::size_t peer = 0;
    std::string work;
    std::vector<double> samples = {};
  };

  /// Every way of every peer that is here to do this; what should be here and is not is noted once.
  std::vector<Contender> contenders(const Workload& workload) {
    std::vector<Contender> out;
    for (std::size_t i = 0; i < all_.size(); i++) {
      const std::string& program = all_[i].program.program;
      if (std::find(workload.peers.begin(), workload.peers.end(), program) == workload.peers.end()) continue;
      for (const std::string& work : works(all_[i]))
        if (work.substr(0, work.find('@')) == workload.name) out.push_back({i, work});
    }
    return out;
  }

  /// One more sample; false if the peer failed, which is noted.
  bool sample(Contender& contender) try {
    Peer& peer = all_[contender.peer];
    if (!peer.process || !peer.process->alive()) peer.process = started(peer.program);
    contender.samples.push_back(peer.process->sample(contender.work));
    return true;
  } catch (const PeerFailure& failure) {
    note(failure.what());
    return false;
  }

  /// "torch" or "torch@channels_last".
  std::string label(const Contender& c) const {
    const std::size_t way = c.work.find('@');
    return all_[c.peer].program.name + (way == std::string::npos ? "" : c.work.substr(way));
  }

 private:
  struct Peer {
    PeerProgram program;
    std::unique_ptr<PeerProcess> process;
    std::vector<std::string> works;
    bool asked = false;
  };

  static std::unique_ptr<PeerProcess> started(const PeerProgram& program) {
    return std::make_unique<PeerProcess>(program, path_of(program));
  }
  static fs::path path_of(const PeerProgram& program) { return peer_folder() / ("cloam-peer-" + program.program); }

  void note(const std::string& line) {
    auto& notes = report_.notes;
    if (std::find(notes.begin(), notes.end(), line) == notes.end()) notes.push_back(line);
  }

  const std::vector<std::string>& works(Peer& peer) {
    if (peer.asked) return peer.works;
    peer.asked = true;
    if (!fs::exists(path_of(peer.program))) {
      note(text("peer ", peer.program.program, " is not built: apt-get install ", peer.program.package,
                ", then build again (script/benchmark does both)"));
      return peer.works;
    }
    try {
      peer.process = started(peer.program);
      peer.works = peer.process->list();
      report_.peers.push_back({peer.program.name, peer.process->library(), peer.program.environment});
    } catch (const PeerFailure& failure) { note(failure.what()); }
    return peer.works;
  }

  std::vector<Peer> all_;
  BenchReport& report_;
};

/// What our runs cost beside time, summed over the samples.
class Costs {
 public:
  void sample(const Sampler& sampler) {
    const DeviceStats before = device_stats();
    const double ms = sampler.sample();
    const DeviceStats& after = device_stats();
    milliseconds_.push_back(ms);
    runs_ += sampler.repeats();
    seconds_ += 1e-3 * ms * sampler.repeats();
    waited_ += after.wait_seconds - before.wait_seconds;
    launches_ += static_cast<double>(after.launches - before.launches);
    bytes_ += static_cast<double>(after.allocated_bytes - before.allocated_bytes);
  }
  double last_seconds(const Sampler& sampler) const { return 1e-3 * milliseconds_.back() * sampler.repeats(); }
  void write(BenchRow& row) const {
    row.ms = median(milliseconds_);
    row.host_share = std::max(0.0, 1 - waited_ / seconds_);
    row.launches = launches_ / runs_;
    row.bytes_allocated = bytes_ / runs_;
  }

 private:
  std::vector<double> milliseconds_;
  double runs_ = 0, seconds_ = 0, waited_ = 0, launches_ = 0, bytes_ = 0;
};

std::string rows_of(const std::vector<Choice>& choices) {
  std::string out;
  for (const Choice& choice : choices) out += (out.empty() ? "" : "; ") + choice.variant->row();
  return out;
}

void add_peers(BenchRow& row, const Peers& peers, const std::vector<Peers::Contender>& contenders) {
  for (const auto& c : contenders)
    if (!c.samples.empty()) row.peers.push_back({peers.label(c), median(c.samples)});
  std::stable_sort(row.peers.begin(), row.peers.end(), [](const auto& a, const auto& b) { return a.ms < b.ms; });
}

/// Ways of a peer that have a floor of their own become rows of their own: they do not compete with the others.
std::vector<BenchRow> split(const BenchRow& row) {
  std::vector<BenchRow> out = {row};
  out.front().peers.clear();
  for (const PeerTime& peer : row.peers) {
    const std::size_t way = std::min(peer.name.find('@'), peer.name.size());
    const std::string own = row.name + peer.name.substr(way), name = floor_of(own) ? own : row.name;
    auto place = std::find_if(out.begin(), out.end(), [&](const BenchRow& r) { return r.name == name; });
    if (place == out.end()) {
      place = out.insert(out.end(), row);
      place->name = name;
      place->peers.clear();
    }
    place->peers.push_back(peer);
  }
  return out;
}

std::vector<BenchRow> measure(const Workload& workload, Peers& peers, const BenchOptions& options) {
  BenchRow row;
  row.name = workload.name;
  row.flops = workload.flops;
  row.bytes = workload.bytes;
  const Run run = workload.prepare();
  row.variant = rows_of(choices_of(run));
  const Sampler sampler(run);
  Costs costs;
  auto contenders = options.peers ? peers.contenders(workload) : std::vector<Peers::Contender>();
  std::erase_if(contenders, [&](auto& c) { return !peers.sample(c); });
  for (auto& c : contenders) c.samples.clear();  // they have prepared and warmed up
  int rounds = options.rounds ? options.rounds : 9;
  for (int round = 0; round < rounds; round++) {
    const auto start = std::chrono::steady_clock::now();
    std::this_thread::sleep_for(kPause);
    costs.sample(sampler);
    std::erase_if(contenders, [&](auto& c) {
      std::this_thread::sleep_for(kPause);
      return !peers.sample(c);
    });
    const bool slow = std::chrono::steady_clock::now() - start > std::chrono::seconds(1);
    if (slow && !options.rounds) rounds = 5;
  }
  costs.write(row);
  add_peers(row, peers, contenders);
  return split(row);
}

}  // namespace

double BenchRow::share(const DeviceLimits& limits) const {
  if (flops > 0) return gflops() / limits.gflops;
  return gbps() / limits.copy_gbps;
}

namespace {

std::size_t common_length(const std::string& a, const std::string& b) {
  return static_cast<std::size_t>(std::mismatch(a.begin(), a.end(), b.begin(), b.end()).first - a.begin());
}

/// Up to six names that begin as the pattern does, as far as any does.
std::string nearest_names(const Workloads& all, const std::string& pattern) {
  std::size_t most = 0;
  for (const Workload& w : all) most = std::max(most, common_length(w.name, pattern));
  std::string out;
  int count = 0;
  for (const Workload& w : all)
    if (common_length(w.name, pattern) == most && count++ < 6) out += "\n  " + w.name;
  return out;
}

}  // namespace

Workloads chosen_workloads(const Workloads& all, const std::vector<std::string>& patterns) {
  const auto matches = [](const Workload& w, const std::string& p) { return w.name.find(p) != std::string::npos; };
  for (const std::string& p : patterns)
    if (std::none_of(all.begin(), all.end(), [&](const Workload& w) { return matches(w, p); }))
      throw Error(Fault::usage,
                  text("no workload has \"", p, "\" in its name; the nearest are:", nearest_names(all, p)));
  Workloads out;
  for (const Workload& w : all)
    if (patterns.empty() || std::any_of(patterns.begin(), patterns.end(), [&](const auto& p) { return matches(w, p); }))
      out.push_back(w);
  return out;
}

BenchReport run_bench(const Workloads& workloads, const BenchOptions& options,
                      const std::function<void(const std::string&)>& tell) {
  BenchReport report;
  const auto start = std::chrono::steady_clock::now();
  tell("the device's limits");
  report.limits = measure_limits();
  Peers peers(report);
  for (std::size_t i = 0; i < workloads.size(); i++) {
    const std::chrono::duration<double> used = std::chrono::steady_clock::now() - start;
    if (options.budget_seconds > 0 && used.count() > options.budget_seconds) {
      report.notes.push_back(text("the budget ended before ", workloads.size() - i, " of ", workloads.size(),
                                  " workloads, the first of them ", workloads[i].name));
      break;
    }
    tell(text(i + 1, "/", workloads.size(), " ", workloads[i].name));
    try {
      for (const BenchRow& row : measure(workloads[i], peers, options)) report.rows.push_back(row);
    } catch (const Error& error) { report.notes.push_back(text(workloads[i].name, " could not run: ", error.what())); }
    trim_memory();
  }
  return report;
}

}  // namespace cloam
