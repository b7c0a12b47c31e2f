// See process.h.
#include "tests/cli/process.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <thread>

#include "models/synth/synthetic_scene.h"
#include "tests/cli/schemas.h"

extern char** environ;

namespace cloam {
namespace {

namespace fs = std::filesystem;

double now() { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); }

struct Scratch {
  fs::path path;
  Scratch() {
    std::string pattern = (fs::temp_directory_path() / "cloam-cli-XXXXXX").string();
    if (!mkdtemp(pattern.data())) throw std::runtime_error("no temporary folder");
    path = pattern;
  }
  ~Scratch() {
    std::error_code ignored;
    fs::remove_all(path, ignored);
  }
};

fs::path fresh(const char* kind) {
  static int count = 0;
  return scratch() / (kind + std::to_string(++count));
}

std::vector<char*> pointers(Words& words) {
  std::vector<char*> out;
  for (std::string& word : words) out.push_back(word.data());
  out.push_back(nullptr);
  return out;
}

fs::path trained_into(const std::string& name, const Words& how) {
  const Outcome outcome = cloam_with(small_training(small_scene(), scratch() / name, how));
  if (outcome.code != 0) throw std::runtime_error(outcome.err);
  return scratch() / name;
}

/// What is kept of sweeps lies in the tests' own folder, unless the test says where.
Words merged_environment(Words over) {
  const std::string kept = "CLOAM_DATA_CACHE=";
  if (std::none_of(over.begin(), over.end(), [&](const std::string& word) { return word.starts_with(kept); }))
    over.push_back(kept + (scratch() / "kept").string());
  Words all = over;
  for (char** entry = environ; *entry; ++entry) {
    const std::string line = *entry, name = line.substr(0, line.find('=') + 1);
    bool replaced = false;
    for (const std::string& other : over) replaced = replaced || other.starts_with(name);
    if (!replaced) all.push_back(line);
  }
  return all;
}

}  // namespace

Process::Process(const Words& arguments, const Words& environment, const std::string& stdout_to)
    : out_(stdout_to.empty() ? fresh("out") : fs::path(stdout_to)), err_(fresh("err")), started_(now()) {
  Words words = {CLOAM_BINARY};
  words.insert(words.end(), arguments.begin(), arguments.end());
  Words variables = merged_environment(environment);
  const auto argv = pointers(words), envp = pointers(variables);
  id_ = fork();
  if (id_ != 0) return;
  dup2(open(out_.c_str(), O_WRONLY | O_CREAT, 0644), STDOUT_FILENO);
  dup2(open(err_.c_str(), O_WRONLY | O_CREAT, 0644), STDERR_FILENO);
  execve(argv[0], argv.data(), envp.data());
  _exit(127);
}

Process::~Process() {
  if (ended_) return;
  kill(id_, SIGKILL);
  reap(0);
}

void Process::reap(int options) { ended_ = ended_ || waitpid(id_, &status_, options) == id_; }
void Process::signal(int number) const { kill(id_, number); }

std::string Process::said() const { return content_of(err_); }

bool Process::running() {
  reap(WNOHANG);
  return !ended_;
}

Outcome Process::wait() {
  reap(0);
  Outcome outcome;
  outcome.code = WIFEXITED(status_) ? WEXITSTATUS(status_) : -WTERMSIG(status_);
  outcome.out = fs::is_regular_file(out_) ? content_of(out_) : "";
  outcome.err = content_of(err_);
  outcome.seconds = now() - started_;
  return outcome;
}

Outcome cloam_with(const Words& arguments, const Words& environment, const std::string& stdout_to) {
  const Outcome outcome = Process(arguments, environment, stdout_to).wait();
  check_by_schemas(arguments, outcome);
  return outcome;
}

const fs::path& scratch() {
  static const Scratch folder;
  return folder.path;
}

std::string content_of(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

void write_text(const fs::path& path, const std::string& content) { std::ofstream(path, std::ios::binary) << content; }

nlohmann::json json_of(const fs::path& path) { return nlohmann::json::parse(content_of(path)); }

std::map<std::string, std::string> snapshot(const fs::path& folder) {
  std::map<std::string, std::string> files;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    files[fs::relative(entry.path(), folder).string()] = entry.is_regular_file() ? content_of(entry.path()) : "folder";
  }
  return files;
}

bool wait_for(const fs::path& path, Process& process) {
  for (const double start = now(); now() - start < 60;) {
    if (fs::exists(path)) return process.running();
    if (!process.running()) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  return false;
}

const fs::path& small_scene() {
  static const fs::path folder = [] {
    write_synthetic_scene(scratch() / "scene", {.train = 8, .test = 2, .size = 24});
    return scratch() / "scene";
  }();
  return folder;
}

fs::path copy_of(const fs::path& folder, const std::string& name) {
  fs::copy(folder, scratch() / name, fs::copy_options::recursive);
  return scratch() / name;
}

fs::path copy_of_scene(const std::string& name) { return copy_of(small_scene(), name); }

const fs::path& small_run() {
  static const fs::path run = trained_into("precious", {"--steps", "6", "--save-every", "3"});
  return run;
}

const fs::path& stopped_run() {
  static const fs::path run = trained_into("stopped-after-five", {"--steps", "40", "--stop-after", "5"});
  return run;
}

Words without_pictures(Words training) {
  for (const char* asked_for : {"--pictures", "--preview-every"})
    if (std::find(training.begin(), training.end(), asked_for) != training.end()) return training;
  training.insert(training.end(), {"--pictures", "off"});
  return training;
}

Words small_training(const fs::path& data, const fs::path& run, const Words& more) {
  Words words = {"train", "nerf", data.string(), "-o", run.string(), "--progress", "plain"};
  for (const char* setting : {"field.log2_rows=10", "field.levels=4", "batch.rays=64", "batch.samples=4096",
                              "occupancy.side=16", "occupancy.cells=512", "occupancy.start=8", "occupancy.every=4"}) {
    words.insert(words.end(), {"--set", setting});
  }
  words.insert(words.end(), more.begin(), more.end());
  return without_pictures(words);
}

}  // namespace cloam
