// See peer_process.h; the protocol is told in peers/peer.h.
#include "benchmarks/peer_process.h"

#include <poll.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <cstring>
#include <sstream>
#include <thread>

#include "runtime/device.h"
#include "runtime/error.h"

extern char** environ;

namespace cloam {
namespace {

using Words = std::vector<std::string>;

constexpr int kPatienceMs = 300'000;  // a first sample may compile kernels

/// Ours, where `over` does not set the same name.
Words merged_environment(const Words& over) {
  Words all = over;
  for (char** entry = environ; *entry; ++entry) {
    const std::string line = *entry, name = line.substr(0, line.find('=') + 1);
    bool replaced = false;
    for (const std::string& other : over) replaced = replaced || other.starts_with(name);
    if (!replaced) all.push_back(line);
  }
  return all;
}

std::vector<char*> pointers(Words& words) {
  std::vector<char*> out;
  for (std::string& word : words) out.push_back(word.data());
  out.push_back(nullptr);
  return out;
}

std::string ending(int status) {
  if (WIFSIGNALED(status)) return text("died of signal ", WTERMSIG(status), " (", strsignal(WTERMSIG(status)), ")");
  return text("ended with exit code ", WEXITSTATUS(status));
}

}  // namespace

const std::vector<PeerProgram>& peer_programs() {
  static const std::vector<PeerProgram> all = [] {
    const std::string cores = std::to_string(std::thread::hardware_concurrency());
    const Words common = {"OMP_NUM_THREADS=" + cores, "OPENBLAS_NUM_THREADS=" + cores, "MALLOC_MMAP_MAX_=0",
                          "MALLOC_TRIM_THRESHOLD_=8589934592"};
    const auto with = [](Words words, const Words& more) {
      words.insert(words.end(), more.begin(), more.end());
      return words;
    };
    const Words bound = with(common, {"OMP_PROC_BIND=true", "OMP_PLACES=cores"});
    const Words passive = with(bound, {"OMP_WAIT_POLICY=passive", "OPENBLAS_THREAD_TIMEOUT=4"});
    return std::vector<PeerProgram>{
        {"openblas", "openblas", "libopenblas-dev", common},
        {"onednn", "onednn", "libdnnl-dev", bound},
        {"torch", "torch", "libtorch-dev", bound},
        {"torch+passive", "torch", "libtorch-dev", passive},
        {"clblast", "clblast", "libclblast-dev", with(common, {"CLOAM_PEER_DEVICE=" + device().id})},
        {"host", "host", "g++", bound}};
  }();
  return all;
}

PeerProcess::PeerProcess(const PeerProgram& program, const std::filesystem::path& path)
    : name_(program.name), errors_(std::tmpfile(), std::fclose) {
  int ends[2];
  if (!errors_ || socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0)
    throw PeerFailure(text("peer ", name_, " cannot be started: ", std::strerror(errno)));
  Words words = {path.string()}, variables = merged_environment(program.environment);
  const auto argv = pointers(words), envp = pointers(variables);
  socket_ = ends[0];
  id_ = fork();
  if (id_ == 0) {  // only calls that are safe after a fork of a process with threads
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    dup2(ends[1], STDIN_FILENO);
    dup2(ends[1], STDOUT_FILENO);
    dup2(fileno(errors_.get()), STDERR_FILENO);
    execve(argv[0], argv.data(), envp.data());
    _exit(127);
  }
  close(ends[1]);
}

PeerProcess::~PeerProcess() { (void)end(); }

int PeerProcess::end() {
  int status = 0;
  if (id_ > 0) {
    kill(id_, SIGKILL);
    waitpid(id_, &status, 0);
  }
  if (socket_ >= 0) close(socket_);
  id_ = socket_ = -1;
  return status;
}

std::string PeerProcess::last_words() const {
  std::string content(4096, '\0');
  const off_t size = lseek(fileno(errors_.get()), 0, SEEK_END);
  const off_t from = std::max<off_t>(0, size - static_cast<off_t>(content.size()));
  const ssize_t count = pread(fileno(errors_.get()), content.data(), content.size(), from);
  content.resize(static_cast<std::size_t>(std::max<ssize_t>(count, 0)));
  std::istringstream lines(content);
  std::string out;
  for (std::string line; std::getline(lines, line);) out += "\n    " + line;
  return out.empty() ? "; it wrote nothing on stderr" : "; it wrote:" + out;
}

void PeerProcess::fail(const std::string& how) { throw PeerFailure(text("peer ", name_, " ", how, last_words())); }

std::string PeerProcess::ask(const std::string& request) {
  const std::string line = request + "\n";
  const auto lost = [&] {
    int status = 0;
    if (id_ > 0 && waitpid(id_, &status, 0) == id_) id_ = -1;
    (void)end();
    fail(ending(status) + " at \"" + request + "\"");
  };
  if (!alive() || send(socket_, line.data(), line.size(), MSG_NOSIGNAL) != static_cast<ssize_t>(line.size())) lost();
  while (unread_.find('\n') == std::string::npos) {
    pollfd ready{socket_, POLLIN, 0};
    if (poll(&ready, 1, kPatienceMs) <= 0) {
      (void)end();
      fail(text("gave no answer to \"", request, "\" in ", kPatienceMs / 1000, " s"));
    }
    char buffer[4096];
    const ssize_t count = read(socket_, buffer, sizeof buffer);
    if (count <= 0) lost();
    unread_.append(buffer, static_cast<std::size_t>(count));
  }
  const std::string answer = unread_.substr(0, unread_.find('\n'));
  unread_.erase(0, answer.size() + 1);
  if (answer.starts_with("error: ")) throw PeerFailure(text("peer ", name_, ", ", request, ": ", answer.substr(7)));
  return answer;
}

std::vector<std::string> PeerProcess::list() {
  std::istringstream words(ask("list"));
  std::vector<std::string> out;
  for (std::string word; words >> word;) out.push_back(word);
  return out;
}

double PeerProcess::sample(const std::string& work) {
  const std::string answer = ask("sample " + work);
  char* end_of_number = nullptr;
  const double milliseconds = std::strtod(answer.c_str(), &end_of_number);
  if (end_of_number == answer.c_str() || *end_of_number || !(milliseconds > 0))
    throw PeerFailure(text("peer ", name_, " answered \"", answer, "\" where milliseconds were expected"));
  return milliseconds;
}

}  // namespace cloam
