// Ranks by MPI: the one file that knows it. It is a library of its own (lib/cloam/cloam-mpi.so) that the program opens
// when mpirun started it, so that nobody else needs MPI.
#include <mpi.h>

#include <algorithm>
#include <chrono>
#include <thread>

#include "models/train/ranks_library.h"

namespace cloam {
namespace {

constexpr size_t kMessage = size_t{1} << 30;              // bytes: MPI counts in int
constexpr auto kPatience = std::chrono::milliseconds(2);  // of looking again and again, before it sleeps in between
constexpr auto kNap = std::chrono::microseconds(100);

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
        MPI_Irecv(part.data(), static_cast<int>(part.size()), MPI_BYTE, peer, 0, MPI_COMM_WORLD, &request);
        pending.add(request, peer);
      }
      for (size_t begin = 0; begin < to[at].size(); begin += kMessage) {
        const auto part = to[at].subspan(begin, std::min(kMessage, to[at].size() - begin));
        MPI_Isend(part.data(), static_cast<int>(part.size()), MPI_BYTE, peer, 0, MPI_COMM_WORLD, &request);
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

  void end() override { MPI_Finalize(); }
  void end_all(int code) override { MPI_Abort(MPI_COMM_WORLD, code); }

 private:
  int rank_ = 0, size_ = 1;
};

}  // namespace
}  // namespace cloam

extern "C" cloam::RanksLibrary* cloam_ranks() {
  static cloam::MpiRanks ranks;
  return &ranks;
}
