// Peers: other libraries, timed by programs of their own (benchmarks/peers) that lie beside ours.
#pragma once
#include <sys/types.h>

#include <cstdio>
#include <filesystem>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

namespace cloam {

/// A peer in one environment. libtorch has two: it computes products with OpenBLAS' threads and all else with
/// libgomp's, and each of the two pools spins for a while after its work on the cores that the other one needs. Told to
/// sleep at once they do not disturb each other, but wake later. The faster counts.
struct PeerProgram {
  std::string name, program;  // "torch+passive" is the program cloam-peer-torch
  std::string package;        // of Debian, that its build needs
  std::vector<std::string> environment;
};
/// All, with what is set beside our own environment: one thread a core, held to it where libgomp's are used (OpenBLAS'
/// run at half speed if they are), and a malloc that keeps its memory (with glibc's own settings large tensors go back
/// to the system at once, and first touches cost most of the time).
const std::vector<PeerProgram>& peer_programs();

/// The peer died, hung, or answered with an error.
class PeerFailure : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// A running peer; ends with this object, or with us.
class PeerProcess {
 public:
  /// Throws PeerFailure when it cannot be started.
  PeerProcess(const PeerProgram& program, const std::filesystem::path& path);
  ~PeerProcess();
  PeerProcess(const PeerProcess&) = delete;
  PeerProcess& operator=(const PeerProcess&) = delete;

  /// What it times, with the version. Throws PeerFailure.
  std::string library() { return ask("library"); }
  /// The names of its works. Throws PeerFailure.
  std::vector<std::string> list();
  /// Milliseconds of one run. Throws PeerFailure.
  double sample(const std::string& work);
  bool alive() const { return id_ > 0; }

 private:
  std::string ask(const std::string& request);
  [[noreturn]] void fail(const std::string& how);
  std::string last_words() const;
  int end();

  std::string name_, unread_;
  pid_t id_ = -1;
  int socket_ = -1;
  std::unique_ptr<std::FILE, int (*)(std::FILE*)> errors_{nullptr, std::fclose};  // what it writes on stderr
};

}  // namespace cloam
