// See child_program.h.
#include "cli/child_program.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <sstream>

#include "cli/stop_signal.h"
#include "runtime/error.h"

extern char** environ;

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr int kLookMs = 20;  // between looks at stop_signal
constexpr std::size_t kLastLines = 12;

std::vector<std::string> merged_environment(const std::vector<std::string>& over) {
  std::vector<std::string> all = over;
  for (char** entry = environ; *entry; ++entry) {
    const std::string line = *entry, name = line.substr(0, line.find('=') + 1);
    bool replaced = false;
    for (const std::string& other : over) replaced = replaced || other.starts_with(name);
    if (!replaced) all.push_back(line);
  }
  return all;
}

std::vector<char*> pointers(std::vector<std::string>& words) {
  std::vector<char*> out;
  for (std::string& word : words) out.push_back(word.data());
  out.push_back(nullptr);
  return out;
}

/// The program in a process group of its own: Ctrl-C on a terminal reaches us alone, and we end the whole group.
struct Started {
  pid_t id = -1;
  int output = -1;
};

Started start(const ChildProgram& program) {
  std::vector<std::string> words = {program.path.string()}, variables = merged_environment(program.environment);
  words.insert(words.end(), program.arguments.begin(), program.arguments.end());
  const auto argv = pointers(words), envp = pointers(variables);
  int ends[2];
  if (pipe2(ends, O_CLOEXEC) != 0) throw Error(Fault::internal, text("no pipe: ", std::strerror(errno)));
  const int nothing = open("/dev/null", O_RDONLY | O_CLOEXEC);
  const pid_t id = fork();
  if (id == 0) {  // only calls that are safe after a fork of a process with threads
    setpgid(0, 0);
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    dup2(nothing, STDIN_FILENO);
    dup2(ends[1], STDOUT_FILENO);
    dup2(ends[1], STDERR_FILENO);
    execve(argv[0], argv.data(), envp.data());
    _exit(127);
  }
  close(nothing);
  close(ends[1]);
  if (id > 0) return {id, ends[0]};
  close(ends[0]);
  throw Error(Fault::internal, text(program.path.string(), " cannot be started: ", std::strerror(errno)));
}

/// Whole lines of what was read so far.
void tell_lines(std::string& unread, const std::function<void(const std::string&)>& seen) {
  for (std::size_t end = unread.find_first_of("\n\r"); end != std::string::npos; end = unread.find_first_of("\n\r")) {
    if (end > 0) seen(unread.substr(0, end));
    unread.erase(0, end + 1);
  }
}

/// Until the program closes its output.
void read_lines(const Started& child, const std::function<void(const std::string&)>& seen) {
  std::string unread;
  for (bool asked = false;;) {
    if (stop_signal.load() != 0 && !asked) asked = kill(-child.id, SIGTERM) == 0;
    pollfd ready{child.output, POLLIN, 0};
    if (poll(&ready, 1, kLookMs) <= 0) continue;
    char buffer[4096];
    const ssize_t count = read(child.output, buffer, sizeof buffer);
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) break;
    unread.append(buffer, static_cast<std::size_t>(count));
    tell_lines(unread, seen);
  }
  unread += "\n";
  tell_lines(unread, seen);
}

}  // namespace

fs::path find_program(const std::string& name) {
  const char* path = std::getenv("PATH");
  std::istringstream folders(path ? path : "/usr/local/bin:/usr/bin:/bin");
  for (std::string folder; std::getline(folders, folder, ':');) {
    const fs::path candidate = fs::path(folder.empty() ? "." : folder) / name;
    std::error_code error;
    if (fs::is_regular_file(candidate, error) && access(candidate.c_str(), X_OK) == 0) return candidate;
  }
  return {};
}

std::string ChildEnd::in_words() const {
  return text("ended ", code < 0 ? "by signal " : "with code ", std::abs(code),
              code == -SIGKILL ? " (out of memory?)" : "",
              said.empty() ? "; it printed nothing" : "; it printed:", said);
}

bool ChildEnd::is_of_full_disk() const {
  const char* const words[] = {std::strerror(ENOSPC), std::strerror(EDQUOT), std::strerror(EFBIG), "disk is full"};
  return std::any_of(std::begin(words), std::end(words),
                     [&](const char* word) { return said.find(word) != std::string::npos; });
}

ChildEnd run_child(const ChildProgram& program, const std::function<void(const std::string& line)>& seen) {
  const Started child = start(program);
  std::deque<std::string> last;
  int status = 0;
  try {
    read_lines(child, [&](const std::string& line) {
      seen(line);
      last.push_back(line);
      if (last.size() > kLastLines) last.pop_front();
    });
  } catch (...) {
    kill(-child.id, SIGKILL);
    close(child.output);
    waitpid(child.id, &status, 0);
    throw;
  }
  close(child.output);
  while (waitpid(child.id, &status, 0) < 0 && errno == EINTR) {
    if (stop_signal.load() != 0) kill(-child.id, SIGTERM);
  }
  ChildEnd end{WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status), {}};
  for (const std::string& line : last) end.said += "\n    " + line;
  return end;
}

void start_apart(const ChildProgram& program) {
  std::vector<std::string> words = {program.path.string()}, variables = merged_environment(program.environment);
  words.insert(words.end(), program.arguments.begin(), program.arguments.end());
  const auto argv = pointers(words), envp = pointers(variables);
  const int nothing = open("/dev/null", O_RDWR | O_CLOEXEC);
  const pid_t id = fork();
  if (id == 0) {  // only calls that are safe after a fork of a process with threads
    setsid();
    if (fork() != 0) _exit(0);  // what is left is no child of ours
    for (const int stream : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO}) dup2(nothing, stream);
    execve(argv[0], argv.data(), envp.data());
    _exit(127);
  }
  close(nothing);
  while (id > 0 && waitpid(id, nullptr, 0) < 0 && errno == EINTR) {}
}

}  // namespace cloam
