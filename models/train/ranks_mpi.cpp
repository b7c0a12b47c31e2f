// Ranks by MPI: the one file that knows it. It is a library of its own (lib/cloam/cloam-mpi.so) that the program opens
// when mpirun started it, so that nobody else needs MPI.
#include <mpi.h>

#include <algorithm>
#include <chrono>
#include <thread>

#include "models/train/ranks_library.h"

namespace cloam {
namespace {

constexpr int kTraded = 0, kGoesOn = 1, kIsHere = 2;      // tags
constexpr auto kHeardEvery = std::chrono::seconds(1);     // at most
constexpr size_t kMessage = size_t{1} << 30;              // bytes: MPI counts in int
constexpr auto kPatience = std::chrono::milliseconds(2);  // of looking again and again, before it sleeps in between
constexpr auto kNap = std::chrono::microseconds(100);
constexpr auto kLongNap = std::chrono::milliseconds(2);  // where others may work on for minutes

using Clock = std::chrono::steady_clock;

/// What one call of trade() waits for.
struct Pending {
  std::vector<MPI_Request> requests;
  std::vector<int> peers;

  void add(const MPI_Request& request, int peer) {
    requests.push_back(request);
    peers.push_back(peer);
  }
  bool done() {
    int all = 0;
    MPI_Testall(static_cast<int>(requests.size()), requests.data(), &all, MPI_STATUSES_IGNORE);
    return all != 0;
  }
  /// The ranks that have not answered, or not taken what was sent.
  std::vector<int> silent() {
    std::vector<int> ranks;
    for (size_t i = 0; i < requests.size(); ++i) {
      int done = 0;
      MPI_Test(&requests[i], &done, MPI_STATUS_IGNORE);
      if (!done && std::find(ranks.begin(), ranks.end(), peers[i]) == ranks.end()) ranks.push_back(peers[i]);
    }
    return ranks;
  }
};

class MpiRanks final : public RanksLibrary {
 public:
  MpiRanks() {
    MPI_Init(nullptr, nullptr);
    MPI_Comm_rank(MPI_COMM_WORLD, &rank_);
    MPI_Comm_size(MPI_COMM_WORLD, &size_);
  }
  int rank() const override { return rank_; }
  int size() const override { return size_; }

  std::vector<int> trade(const std::vector<std::span<const std::byte>>& to,
                         const std::vector<std::span<std::byte>>& from, double seconds) override {
    Pending pending;
    MPI_Request request = MPI_REQUEST_NULL;
    for (int peer = 0; peer < size_; ++peer) {
      const auto at = static_cast<size_t>(peer);
      if (peer == rank_) continue;
      for (size_t begin = 0; begin < from[at].size(); begin += kMessage) {
        const auto part = from[at].subspan(begin, std::min(kMessage, from[at].size() - begin));
        MPI_Irecv(part.data(), static_cast<int>(part.size()), MPI_BYTE, peer, kTraded, MPI_COMM_WORLD, &request);
        pending.add(request, peer);
      }
      for (size_t begin = 0; begin < to[at].size(); begin += kMessage) {
        const auto part = to[at].subspan(begin, std::min(kMessage, to[at].size() - begin));
        MPI_Isend(part.data(), static_cast<int>(part.size()), MPI_BYTE, peer, kTraded, MPI_COMM_WORLD, &request);
        pending.add(request, peer);
      }
    }
    const Clock::time_point begun = Clock::now();
    while (!pending.done()) {
      const auto waited = Clock::now() - begun;
      if (std::chrono::duration<double>(waited).count() > seconds) return pending.silent();
      if (waited > kPatience)
        std::this_thread::sleep_for(kNap);
      else
        std::this_thread::yield();  // a CPU device may work on this core
    }
    return {};
  }

  std::vector<int> await_all(double seconds) override {
    std::vector<std::byte> bytes(static_cast<size_t>(size_) + 1);
    Pending pending;
    for (int peer = 0; peer < size_; ++peer) {
      if (peer == rank_) continue;
      MPI_Request request = MPI_REQUEST_NULL;
      MPI_Irecv(&bytes[static_cast<size_t>(peer)], 1, MPI_BYTE, peer, kIsHere, MPI_COMM_WORLD, &request);
      pending.add(request, peer);
      MPI_Isend(&bytes.back(), 1, MPI_BYTE, peer, kIsHere, MPI_COMM_WORLD, &request);
      pending.add(request, peer);
    }
    std::vector<Clock::time_point> heard(static_cast<size_t>(size_), Clock::now());
    while (!pending.done()) {
      hear(heard);
      std::vector<int> silent;
      for (const int peer : pending.silent()) {
        const auto since = Clock::now() - heard[static_cast<size_t>(peer)];
        if (std::chrono::duration<double>(since).count() > seconds) silent.push_back(peer);
      }
      if (!silent.empty()) return silent;
      std::this_thread::sleep_for(kLongNap);
    }
    hear(heard);
    return {};
  }

  void be_heard_of() override {
    if (Clock::now() - told_ < kHeardEvery) return;
    told_ = Clock::now();
    static const std::byte nothing{};
    for (int peer = 0; peer < size_; ++peer) {
      if (peer == rank_) continue;
      MPI_Request request = MPI_REQUEST_NULL;
      MPI_Isend(&nothing, 1, MPI_BYTE, peer, kGoesOn, MPI_COMM_WORLD, &request);
      MPI_Request_free(&request);
    }
  }

  void end() override { MPI_Finalize(); }
  void end_all(int code) override { MPI_Abort(MPI_COMM_WORLD, code); }

 private:
  void hear(std::vector<Clock::time_point>& heard) {
    MPI_Status status;
    std::byte nothing{};
    for (int found = 1; found;) {
      MPI_Iprobe(MPI_ANY_SOURCE, kGoesOn, MPI_COMM_WORLD, &found, &status);
      if (!found) return;
      MPI_Recv(&nothing, 1, MPI_BYTE, status.MPI_SOURCE, kGoesOn, MPI_COMM_WORLD, MPI_STATUS_IGNORE);
      heard[static_cast<size_t>(status.MPI_SOURCE)] = Clock::now();
    }
  }

  int rank_ = 0, size_ = 1;
  Clock::time_point told_ = Clock::now();
};

}  // namespace
}  // namespace cloam

extern "C" cloam::RanksLibrary* cloam_ranks() {
  static cloam::MpiRanks ranks;
  return &ranks;
}
