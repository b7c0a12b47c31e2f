// The program under mpirun, as several ranks on this machine.
#pragma once
#include <sys/types.h>

#include <filesystem>
#include <string>
#include <vector>

#include "tests/cli/process.h"

namespace cloam {

/// `mpirun -n RANKS cloam ARGUMENTS`; ended and waited for when this is destroyed.
class Ranks {
 public:
  Ranks(int count, const Words& arguments, const Words& environment = {});
  ~Ranks();
  Ranks(const Ranks&) = delete;
  Ranks& operator=(const Ranks&) = delete;
  bool running();
  /// The mpirun itself.
  pid_t launcher() const { return id_; }
  /// The process of a rank; 0 while there is none.
  pid_t process_of(int rank) const;
  /// All processes that mpirun started and that are still there.
  std::vector<pid_t> processes() const;
  Outcome wait();
  std::string said() const { return content_of(err_); }

 private:
  std::filesystem::path out_, err_;
  pid_t id_ = -1;
  bool ended_ = false;
  int status_ = 0;
  double started_ = 0;
};

}  // namespace cloam
