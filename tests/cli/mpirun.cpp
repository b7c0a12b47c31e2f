#include "tests/cli/mpirun.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <sstream>
#include <thread>

namespace cloam {
namespace {

namespace fs = std::filesystem;

double seconds_now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

std::vector<char*> argv_of(Words& words) {
  std::vector<char*> out;
  for (std::string& word : words) out.push_back(word.data());
  out.push_back(nullptr);
  return out;
}

fs::path next_file(const char* kind) {
  static int count = 0;
  return scratch() / ("mpirun_" + std::string(kind) + std::to_string(++count));
}

}  // namespace

Ranks::Ranks(int count, const Words& arguments, const Words& environment)
    : out_(next_file("out")), err_(next_file("err")), started_(seconds_now()) {
  // More ranks than cores, and tests in containers.
  Words words = {"env"};
  words.insert(words.end(), environment.begin(), environment.end());
  words.insert(words.end(),
               {"mpirun", "--allow-run-as-root", "--oversubscribe", "-n", std::to_string(count), CLOAM_BINARY});
  words.insert(words.end(), arguments.begin(), arguments.end());
  const auto argv = argv_of(words);
  id_ = fork();
  if (id_ != 0) return;
  dup2(open("/dev/null", O_RDONLY), STDIN_FILENO);
  dup2(open(out_.c_str(), O_WRONLY | O_CREAT, 0644), STDOUT_FILENO);
  dup2(open(err_.c_str(), O_WRONLY | O_CREAT, 0644), STDERR_FILENO);
  execvp(argv[0], argv.data());
  _exit(127);
}

Ranks::~Ranks() {
  if (ended_) return;
  for (const pid_t process : processes()) kill(process, SIGKILL);
  kill(id_, SIGKILL);
  waitpid(id_, &status_, 0);
}

bool Ranks::running() {
  ended_ = ended_ || waitpid(id_, &status_, WNOHANG) == id_;
  return !ended_;
}

std::vector<pid_t> Ranks::processes() const {
  const std::string process = std::to_string(id_);
  std::istringstream list(content_of("/proc/" + process + "/task/" + process + "/children"));
  std::vector<pid_t> out;
  for (pid_t one = 0; list >> one;) out.push_back(one);
  return out;
}

pid_t Ranks::process_of(int rank) const {
  const std::string variable = std::string(1, '\0') + "OMPI_COMM_WORLD_RANK=" + std::to_string(rank) + '\0';
  for (const pid_t process : processes())
    if (contains(content_of("/proc/" + std::to_string(process) + "/environ"), variable)) return process;
  return 0;
}

Outcome Ranks::wait() {
  if (!ended_) waitpid(id_, &status_, 0);
  ended_ = true;
  Outcome outcome;
  outcome.code = WIFEXITED(status_) ? WEXITSTATUS(status_) : -WTERMSIG(status_);
  outcome.out = content_of(out_);
  outcome.err = content_of(err_);
  outcome.seconds = seconds_now() - started_;
  return outcome;
}

}  // namespace cloam
