// What a training tells while it runs: one line that is rewritten on a terminal, plain lines elsewhere, events as JSON
// lines for programs and in the run's log. Events are documented in docs/formats.md.
#pragma once
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "cli/common.h"
#include "models/train/trainer.h"

namespace cloam {

using Event = nlohmann::ordered_json;

/// A line on stderr that is rewritten where that is a terminal, and not there with -q; it ends with this.
class RewrittenLine {
 public:
  explicit RewrittenLine(const Common& common) : quiet_(common.quiet || muted()) {}
  ~RewrittenLine() { end(); }
  bool on_terminal() const { return terminal_; }
  void draw(const std::string& line);
  void end();

 private:
  const bool quiet_, terminal_ = isatty(STDERR_FILENO) != 0;
  bool open_ = false;
};

enum class ProgressStyle { bar, plain, jsonl, none };

/// auto: bar on a terminal, else plain; jsonl with --json; none with -q.
ProgressStyle progress_style(const std::string& wish, const Common& common);

/// Events as JSON lines: on stdout if asked for, and in a file once one is opened. A log that cannot be written is
/// said once and then left: it must not end a training.
class EventLog {
 public:
  explicit EventLog(bool on_stdout) : on_stdout_(on_stdout) {}
  void open(const fs::path& path);
  /// Adds schema_version, event and t (seconds since the program's start) in front. What comes before open() is kept
  /// for it.
  void write(const std::string& name, const Event& fields);
  /// Is given each event after it was written.
  std::function<void(const std::string& name, const Event& fields)> also = [](const std::string&, const Event&) {};

 private:
  void write_line(const std::string& line);

  bool on_stdout_;
  std::unique_ptr<std::FILE, int (*)(std::FILE*)> file_{nullptr, std::fclose};
  std::string before_open_;
  bool failed_ = false;
};

class ProgressView {
 public:
  ProgressView(ProgressStyle style, EventLog& log) : style_(style), log_(log) {}
  ~ProgressView() { end_line(); }
  void step(const StepReport& report);
  void checkpoint(int64_t step, const fs::path& path, bool tell);
  void warning(const std::string& text);
  /// Where work before the first step stands, now and then.
  void waiting(const std::string& line);
  /// The event of the steps since the last one.
  void tell();
  /// Leaves the rewritten line, so that other text can follow. Tells the last steps, if some were not told.
  void finish();

 private:
  using Clock = std::chrono::steady_clock;
  /// Steps since something was told last.
  struct Window {
    int64_t steps = 0;
    double loss_sum = 0, seconds = 0;
    void add(const StepReport& report);
    double loss() const { return loss_sum / static_cast<double>(steps); }
    double step_seconds() const { return seconds / static_cast<double>(steps); }
  };
  bool draws() const { return style_ == ProgressStyle::bar || style_ == ProgressStyle::plain; }
  double pause() const;  // seconds between two lines
  std::string line() const;
  void draw();
  void print(const std::string& line);
  void end_line();
  double since(Clock::time_point when) const { return std::chrono::duration<double>(Clock::now() - when).count(); }

  ProgressStyle style_;
  EventLog& log_;
  StepReport last_;
  Window undrawn_, untold_;
  int64_t seen_steps_ = 0;
  Clock::time_point drawn_ = Clock::now(), logged_{};
  bool line_open_ = false;
};

}  // namespace cloam
