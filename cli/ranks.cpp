// See ranks.h.
#include "cli/ranks.h"

#include <dlfcn.h>
#include <sched.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <limits>
#include <sstream>
#include <thread>

#include "models/io/words.h"
#include "models/train/ranks_library.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr double kTimeout = 600;  // seconds
constexpr const char* kSharing[] = {"train", "render", "eval", "generate", "simulate", "tables"};
constexpr auto kFirstTells = std::chrono::milliseconds(1500);

double timeout() {
  const char* given = std::getenv("CLOAM_RANK_TIMEOUT");
  if (!given) return kTimeout;
  const double seconds = parse_duration(given);
  if (seconds > 0) return seconds;
  throw Error(Fault::usage, text("CLOAM_RANK_TIMEOUT=", given, ": want a time such as 90s or 10m"));
}

std::string listed(const std::vector<int>& numbers) {
  std::string out;
  for (const int number : numbers) out += text(out.empty() ? "" : ", ", number);
  return out;
}

class LibraryRanks final : public Ranks {
 public:
  LibraryRanks(RanksLibrary& library, double seconds) : library_(library), seconds_(seconds) {}
  int64_t rank() const override { return library_.rank(); }
  int64_t size() const override { return library_.size(); }
  void trade(const std::vector<std::span<const std::byte>>& to,
             const std::vector<std::span<std::byte>>& from) const override {
    require_all(library_.trade(to, from, seconds_), "answered");
  }
  void await_all() const override { library_.await_all(std::numeric_limits<double>::infinity()); }
  void await_work() const override { require_all(library_.await_all(seconds_), "finished a piece of its work"); }
  void finish_piece() const override { library_.be_heard_of(); }
  bool may_share_memory() const override {
    const char* memory = std::getenv("CLOAM_RANK_MEMORY");
    return !memory || std::string_view(memory) != "apart";
  }
  RanksLibrary& library() const { return library_; }

 private:
  void require_all(const std::vector<int>& silent, const char* what) const {
    if (silent.empty()) return;
    throw Error(Fault::device,
                text(silent.size() == 1 ? "rank " : "ranks ", listed(silent), silent.size() == 1 ? " has" : " have",
                     " not ", what, " for ", words_for_seconds(seconds_),
                     ": stopped, hanging, or cut off\n  fix: look at the device and the network of its host; "
                     "CLOAM_RANK_TIMEOUT=30m waits longer"));
  }

  RanksLibrary& library_;
  double seconds_;
};

std::unique_ptr<LibraryRanks>& library_ranks() {
  static std::unique_ptr<LibraryRanks> ranks;
  return ranks;
}

/// As mpirun, srun and their like tell the programs that they start (environment_of_no_rank says otherwise).
bool started_as_one_of_several() {
  const auto number = [](const char* name) {
    const char* value = std::getenv(name);
    return value ? std::atol(value) : 0;
  };
  if (number("OMPI_COMM_WORLD_SIZE") > 1 || number("PMI_SIZE") > 1) return true;
  return std::getenv("PMIX_RANK") && number("SLURM_NTASKS") > 1;
}

RanksLibrary& opened_library() {
  std::error_code error;
  const fs::path program = fs::read_symlink("/proc/self/exe", error);
  const fs::path file = program.parent_path().parent_path() / "lib" / "cloam" / "cloam-mpi.so";
  void* library = dlopen(file.c_str(), RTLD_NOW | RTLD_GLOBAL);
  if (!library) {
    const char* why = dlerror();
    throw Error(Fault::usage,
                text("started as one of several ranks, but without MPI: ", why ? why : file.c_str(),
                     "\n  fix: install libopenmpi-dev and openmpi-bin and build cloam again (script/setup), or "
                     "start it without mpirun"));
  }
  const auto make = reinterpret_cast<RanksLibrary* (*)()>(dlsym(library, "cloam_ranks"));
  if (!make) throw Error(Fault::usage, text(file.string(), " is of another version of cloam: build both again"));
  return *make();
}

std::string host_name() {
  char name[256] = "";
  gethostname(name, sizeof name - 1);
  return name;
}

std::vector<int> allowed_cores() {
  cpu_set_t set;
  std::vector<int> cores;
  if (sched_getaffinity(0, sizeof set, &set) != 0) return cores;
  for (int core = 0; core < CPU_SETSIZE; ++core)
    if (CPU_ISSET(core, &set)) cores.push_back(core);
  return cores;
}

/// The place of this rank among those that gave the same text, and their number.
Share place_among(const std::string& mine) {
  const std::vector<std::string> all = gathered(ranks(), mine);
  const auto own = all.begin() + static_cast<std::ptrdiff_t>(ranks().rank());
  return {std::count(all.begin(), own, mine), std::count(all.begin(), all.end(), mine)};
}

/// mpirun may bind each rank to cores of its own, or leave all of them to all. PoCL would pin its threads from core 0
/// on in every rank.
void split_cores() {
  const std::vector<int> cores = allowed_cores();
  const Share share = place_among(host_name() + " " + listed(cores));
  const auto count = static_cast<int64_t>(cores.size());
  if (count == 0) return;
  int64_t begin = share.begin(count), end = share.end(count);
  if (begin == end) begin = share.rank % count, end = begin + 1;  // more ranks than cores
  cpu_set_t own;
  CPU_ZERO(&own);
  for (int64_t i = begin; i < end; ++i) CPU_SET(cores[static_cast<size_t>(i)], &own);
  sched_setaffinity(0, sizeof own, &own);
  setenv("POCL_MAX_PTHREAD_COUNT", std::to_string(end - begin).c_str(), 0);
}

std::vector<std::string> gpus_of_one_kind() {
  std::vector<std::string> ids;
  std::string name;
  for (const DeviceInfo& info : list_devices()) {
    if (info.is_cpu || (!name.empty() && info.name != name)) continue;
    name = info.name;
    ids.push_back(info.id);
  }
  return ids;
}

}  // namespace

void join_ranks() {
  if (library_ranks() || !started_as_one_of_several()) return;
  const double seconds = timeout();
  library_ranks() = std::make_unique<LibraryRanks>(opened_library(), seconds);
  if (ranks().rank() > 0) mute();
  split_cores();
}

const Ranks& ranks() { return library_ranks() ? *library_ranks() : alone(); }

std::string rank_words() {
  return ranks().size() > 1 ? text("rank ", ranks().rank(), " of ", ranks().size(), ": ") : "";
}

void check_can_share(const std::string& command) {
  const auto found = std::find(std::begin(kSharing), std::end(kSharing), command);
  if (ranks().size() == 1 || found != std::end(kSharing)) return;
  throw Error(Fault::usage, text("cloam ", command, " cannot share its work among ", ranks().size(),
                                 " ranks\n  fix: start it without mpirun; those that can are ",
                                 joined({std::begin(kSharing), std::end(kSharing)})));
}

void take_gpu_in_turn() {
  if (ranks().size() == 1) return;
  const Share here = place_among(host_name());
  const std::vector<std::string> ids = gpus_of_one_kind();
  if (!ids.empty()) setenv("CLOAM_DEVICE", ids[static_cast<size_t>(here.rank) % ids.size()].c_str(), 0);
}

void choose_rank_device(const std::string& devices, Common& common) {
  if (ranks().size() == 1) {
    if (!devices.empty()) throw Error(Fault::usage, "--devices is for the ranks of mpirun; one alone takes --device");
    return;
  }
  std::vector<std::string> ids;
  std::istringstream words(devices);
  for (std::string word; std::getline(words, word, ',');) ids.push_back(word);
  const Share here = place_among(host_name());
  if (!ids.empty()) common.device = ids[static_cast<size_t>(here.rank) % ids.size()];
}

void check_devices_alike() {
  if (ranks().size() == 1) return;
  const std::vector<std::string> all =
      gathered(ranks(), text(device().name, " (", device().platform, ", driver ", device().driver, ")"));
  for (size_t rank = 1; rank < all.size(); ++rank)
    if (all[rank] != all.front())
      throw Error(Fault::device, text("ranks need devices of one kind: rank 0 has ", all.front(), ", rank ", rank,
                                      " has ", all[rank], "\n  fix: --devices, or other hosts"));
}

std::vector<std::string> environment_of_no_rank() {
  if (ranks().size() == 1) return {};
  return {"OMPI_COMM_WORLD_SIZE=1", "PMI_SIZE=1", "SLURM_NTASKS=1"};
}

void leave_ranks() {
  if (!library_ranks()) return;
  ranks().await_all();  // the first may still make a film
  library_ranks()->library().end();
  library_ranks().reset();
}

void await_first_rank() {
  if (ranks().rank() > 0) std::this_thread::sleep_for(kFirstTells);
}

void end_ranks(int code) {
  if (library_ranks()) library_ranks()->library().end_all(code);
}

}  // namespace cloam
