// See run_history.h.
#include "cli/run_history.h"

#include <cmath>
#include <nlohmann/json.hpp>
#include <sstream>

#include "models/io/bytes.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr uint64_t kLargest = uint64_t{1} << 30;

void add(RunHistory::Series& series, int64_t step, const nlohmann::json& fields, const char* key) {
  const auto found = fields.find(key);
  if (found == fields.end() || !found->is_number()) return;
  series.push_back({step, found->get<double>()});
}

/// Steps beyond `step` were lost, and are made again.
void cut(RunHistory& history, int64_t step) {
  for (RunHistory::Series* series : {&history.loss, &history.psnr, &history.rate, &history.held_out})
    std::erase_if(*series, [step](const RunHistory::Point& point) { return point.step > step; });
}

void take(RunHistory& history, const nlohmann::json& event, double& last_time) {
  const std::string name = event.at("event");
  const double time = event.at("t");
  if (name == "plan") last_time = 0;
  if (name == "warning") history.warnings.push_back(event.at("message"));
  if (name == "start") {
    ++history.trainings;
    if (event.contains("command_line")) history.commands.push_back(event.at("command_line"));
    cut(history, event.at("step"));
    last_time = 0;
  }
  history.seconds += std::max(0.0, time - last_time);
  last_time = time;
  if (name == "step") {
    const int64_t step = event.at("step");
    add(history.loss, step, event, "loss");
    add(history.rate, step, event, "learning_rate");
    add(history.psnr, step, event.at("metrics"), "psnr");
  }
  if (name == "eval") add(history.held_out, event.at("step"), event, "psnr");
}

}  // namespace

RunHistory read_history(const fs::path& log) {
  RunHistory history;
  std::error_code error;
  if (!fs::exists(log, error)) return history;
  const auto bytes = read_file(log, kLargest);
  std::istringstream lines(std::string(bytes.begin(), bytes.end()));
  double last_time = 0;
  int number = 1;
  for (std::string line; std::getline(lines, line); ++number) {
    if (lines.eof()) break;  // without an end: a kill cut it
    try {
      take(history, nlohmann::json::parse(line), last_time);
    } catch (const nlohmann::json::exception&) {
      throw Error(Fault::data, text(log.string(), ", line ", number, " is no event of a training: ", line.substr(0, 80),
                                    "\n  fix: remove that line; the log is not needed to go on"));
    }
  }
  return history;
}

}  // namespace cloam
