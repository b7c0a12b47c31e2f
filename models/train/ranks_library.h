// What the library that knows MPI offers to the program. Nothing is thrown across.
#pragma once
#include <cstddef>
#include <span>
#include <vector>

namespace cloam {

class RanksLibrary {
 public:
  virtual ~RanksLibrary() = default;
  virtual int rank() const = 0;
  virtual int size() const = 0;
  /// As Ranks::trade. The ranks that were silent for so long; none: all is done.
  virtual std::vector<int> trade(const std::vector<std::span<const std::byte>>& to,
                                 const std::vector<std::span<std::byte>>& from, double seconds) = 0;
  /// Returns once every rank is here; or the ranks that are not, and that have not called be_heard_of() for so long.
  virtual std::vector<int> await_all(double seconds) = 0;
  /// Lets all others know that this rank goes on.
  virtual void be_heard_of() = 0;
  /// Before the program ends; waits for the others.
  virtual void end() = 0;
  /// Ends all ranks at once.
  virtual void end_all(int code) = 0;
};

}  // namespace cloam

extern "C" {
/// Takes part in what mpirun started.
cloam::RanksLibrary* cloam_ranks();
}
