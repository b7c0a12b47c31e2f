// Runs the real program and looks at what it leaves behind.
#pragma once
#include <sys/types.h>

#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace cloam {

using Words = std::vector<std::string>;

/// code: the exit code, or minus the signal that ended it.
struct Outcome {
  int code = 0;
  std::string out, err;
  double seconds = 0;
};

/// The program with its output in files; ended (SIGKILL) and waited for when this is destroyed.
class Process {
 public:
  /// environment: "NAME=value" over the test's own.
  explicit Process(const Words& arguments, const Words& environment = {}, const std::string& stdout_to = "");
  ~Process();
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;
  void signal(int number) const;
  bool running();
  /// Its stderr so far.
  std::string said() const;
  Outcome wait();

 private:
  void reap(int options);
  pid_t id_ = -1;
  bool ended_ = false;
  int status_ = 0;
  std::filesystem::path out_, err_;
  double started_ = 0;
};

Outcome cloam_with(const Words& arguments, const Words& environment = {}, const std::string& stdout_to = "");

inline bool contains(const std::string& where, const std::string& what) {
  return where.find(what) != std::string::npos;
}

/// A folder of this test process, removed at its end.
const std::filesystem::path& scratch();
std::string content_of(const std::filesystem::path& path);
void write_text(const std::filesystem::path& path, const std::string& content);
nlohmann::json json_of(const std::filesystem::path& path);
/// Every file below a folder with its bytes: equal before and after means that nothing was touched.
std::map<std::string, std::string> snapshot(const std::filesystem::path& folder);
/// Waits (at most a minute) until the file is there and the process still runs.
bool wait_for(const std::filesystem::path& path, Process& process);

/// A small capture (8 training and 2 test views of 24x24), made once.
const std::filesystem::path& small_scene();
/// A copy of it that a test may damage.
std::filesystem::path copy_of_scene(const std::string& name);
/// A finished run of six steps on small_scene(), checkpoints at 3 and 6, made once: to be read, or copied.
const std::filesystem::path& small_run();
/// A run of forty steps on it that was stopped after five, made once: to be read.
const std::filesystem::path& stopped_run();
/// A copy of a folder that a test may change.
std::filesystem::path copy_of(const std::filesystem::path& folder, const std::string& name);
/// Previews, turntables and reports take longer than small trainings: they are off unless the words say otherwise.
Words without_pictures(Words training);
/// `train nerf` on `data` into `run` with settings that make a step take a hundredth of a second, without pictures.
Words small_training(const std::filesystem::path& data, const std::filesystem::path& run, const Words& more);

}  // namespace cloam
