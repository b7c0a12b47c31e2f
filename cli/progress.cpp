// See progress.h. Losses and speeds are means over the steps since the last line: single steps are noise.
#include "cli/progress.h"

#include <fmt/format.h>
#include <sys/ioctl.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <nlohmann/json.hpp>
#include <utility>

#include "runtime/error.h"

namespace cloam {
namespace {

constexpr int kEventSchema = 1;
constexpr double kBarSeconds = 0.2, kPlainSeconds = 5, kEventSeconds = 1;
constexpr int64_t kFirstSteps = 3;  // always told: they show that it runs

int columns() {
  winsize size{};
  if (ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 20) return size.ws_col;
  const char* given = std::getenv("COLUMNS");
  return given && std::atoi(given) > 20 ? std::atoi(given) : 100;
}

bool coloured() {
  const char* off = std::getenv("NO_COLOR");
  return !(off && *off);
}

Event step_event(const StepReport& report, double loss, double step_seconds) {
  Event event = {{"step", report.progress.step}, {"horizon", nullptr}, {"loss", loss}};
  if (report.progress.horizon > 0) event["horizon"] = report.progress.horizon;
  event["last_step"] = nullptr;
  if (report.end > 0) event["last_step"] = report.end;
  event["steps_per_second"] = step_seconds > 0 ? 1 / step_seconds : 0.0;
  event["seconds_left"] = nullptr;
  if (report.seconds_left) event["seconds_left"] = *report.seconds_left;
  event["memory_bytes"] = device_stats().live_bytes;
  event["learning_rate"] = report.rate;
  event["metrics"] = report.metrics;
  return event;
}

}  // namespace

void RewrittenLine::draw(const std::string& line) {
  if (quiet_ || !terminal_) return;
  std::fprintf(stderr, "\r%s\033[K", line.c_str());
  open_ = true;
}

void RewrittenLine::end() {
  if (std::exchange(open_, false)) std::fputc('\n', stderr);
}

ProgressStyle progress_style(const std::string& wish, const Common& common) {
  if (wish == "jsonl" || (wish == "auto" && common.json)) return ProgressStyle::jsonl;
  if (wish == "none" || (wish == "auto" && common.quiet)) return ProgressStyle::none;
  if (wish == "bar") return ProgressStyle::bar;
  if (wish == "plain") return ProgressStyle::plain;
  return isatty(STDERR_FILENO) ? ProgressStyle::bar : ProgressStyle::plain;
}

void EventLog::open(const fs::path& path) {
  file_.reset(std::fopen(path.c_str(), "a"));
  if (!file_) throw Error(Fault::write, text(path.string(), ": cannot be written: ", std::strerror(errno)));
  write_line(before_open_);
  before_open_.clear();
}

void EventLog::write(const std::string& name, const Event& fields) {
  Event event = {{"schema_version", kEventSchema}, {"event", name}, {"t", seconds_since_start()}};
  event.update(fields);
  const std::string line = event.dump(-1, ' ', false, Event::error_handler_t::replace) + "\n";
  if (on_stdout_) std::fwrite(line.data(), 1, line.size(), stdout);
  if (on_stdout_) std::fflush(stdout);
  if (file_)
    write_line(line);
  else
    before_open_ += line;
  also(name, fields);
}

void EventLog::write_line(const std::string& line) {
  if (failed_) return;
  const bool written = std::fwrite(line.data(), 1, line.size(), file_.get()) == line.size();
  failed_ = !written || std::fflush(file_.get()) != 0;
  if (failed_) warn("the run's log cannot be written: " + std::string(std::strerror(errno)));
}

void ProgressView::Window::add(const StepReport& report) {
  ++steps;
  loss_sum += report.loss;
  seconds += report.step_seconds;
}

std::string ProgressView::line() const {
  const Progress& p = last_.progress;
  const double each = undrawn_.step_seconds();
  const double share = static_cast<double>(p.step) / static_cast<double>(std::max<int64_t>(1, last_.end));
  std::string out = text("step ", p.step);
  if (last_.end > 0) out += text("/", last_.end, fmt::format("  {:2.0f}%", 100 * share));
  out += fmt::format("  loss {:.5f}", undrawn_.loss());
  const auto psnr = last_.metrics.find("psnr");
  if (psnr != last_.metrics.end()) out += fmt::format("  psnr {:.1f}", psnr->second);
  const auto gaussians = last_.metrics.find("gaussians");
  if (gaussians != last_.metrics.end()) out += fmt::format("  {:.1f} k gaussians", 1e-3 * gaussians->second);
  if (each > 0) out += each < 1 ? fmt::format("  {:.1f} it/s", 1 / each) : fmt::format("  {:.1f} s/it", each);
  out += "  mem " + words_for_bytes(device_stats().live_bytes);
  if (last_.seconds_left) {
    out += "  left " + words_for_seconds(*last_.seconds_left) + " (" + clock_after(*last_.seconds_left) + ")";
  }
  return out;
}

void ProgressView::draw() {
  if (undrawn_.steps == 0) return;
  print(line());
  undrawn_ = {};
}

void ProgressView::print(const std::string& line) {
  end_build_news();
  const bool bar = style_ == ProgressStyle::bar;
  const std::string now = bar ? line.substr(0, static_cast<std::size_t>(columns() - 1)) : line;
  const char* format = !bar ? "%s\n" : coloured() ? "\r\033[36m%s\033[0m\033[K" : "\r%s\033[K";
  std::fprintf(stderr, format, now.c_str());
  line_open_ = bar;
  drawn_ = Clock::now();
}

void ProgressView::waiting(const std::string& line) {
  if (draws() && since(drawn_) >= pause()) print(line);
}

double ProgressView::pause() const { return style_ == ProgressStyle::bar ? kBarSeconds : kPlainSeconds; }

void ProgressView::step(const StepReport& report) {
  last_ = report;
  ++seen_steps_;
  undrawn_.add(report);
  untold_.add(report);
  if (draws() && (seen_steps_ == 1 || since(drawn_) >= pause())) draw();
  if (seen_steps_ <= kFirstSteps || since(logged_) >= kEventSeconds) tell();
}

void ProgressView::tell() {
  if (untold_.steps == 0) return;
  log_.write("step", step_event(last_, untold_.loss(), untold_.step_seconds()));
  logged_ = Clock::now();
  untold_ = {};
}

void ProgressView::checkpoint(int64_t step, const fs::path& path, bool told) {
  tell();
  log_.write("checkpoint", {{"step", step}, {"path", path.filename().string()}});
  if (!told) return;
  end_line();
  std::fprintf(stderr, "checkpoint %s\n", path.c_str());
}

void ProgressView::warning(const std::string& text) {
  end_line();
  warn(text);
  log_.write("warning", {{"message", text}});
}

void ProgressView::finish() {
  if (draws()) draw();
  tell();
  end_line();
}

void ProgressView::end_line() {
  if (line_open_) std::fprintf(stderr, "\n");
  line_open_ = false;
}

}  // namespace cloam
