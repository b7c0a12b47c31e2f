// cloam view: a page in the browser that shows a run or a file of gaussians, and edits actors.
#include <fmt/format.h>

#include <cstdlib>
#include <nlohmann/json.hpp>

#include "cli/child_program.h"
#include "cli/commands.h"
#include "cli/shipped.h"
#include "cli/stop_signal.h"
#include "cli/view_html.h"
#include "cli/view_run.h"
#include "cli/view_scene.h"
#include "cli/view_server.h"
#include "models/gaussians/formats.h"
#include "models/runs/actor_names.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr char kViewExamples[] =
    R"(Look at a run, or at a file of Gaussian splats, in the browser; edit the actors of a street.

Examples:
  cloam view runs/fox                     a page at an address that is printed; Ctrl-C ends it
  cloam view scene.ply                    also .splat, .spz and .glb
  cloam view runs/street --log 1          move, turn, exchange and hide actors; save as the run that edit writes
  cloam view scene.ply --html scene.html  one file to hand on, which needs neither this program nor a network
  cloam view runs/street --prior runs/assets      where new assets come from
  ssh -L 8017:127.0.0.1:8017 HOST cloam view runs/fox --port 8017 --no-open      from another computer

The address holds a secret, and only programs of this computer can reach it. docs/viewer.md has more.)";

struct ViewRequest {
  std::string what, log, prior, html;
  int port = 0;
  bool no_open = false;
};

/// A file of gaussians: drawn in the browser, so no device is needed.
class FileShown final : public Shown {
 public:
  explicit FileShown(const fs::path& path) : title_(path.filename().string()) {
    SplatFile file = read_gaussians(path);
    for (const std::string& warning : file.warnings) warn(warning);
    gaussians_ = std::move(file.gaussians);
  }
  Answer scene() override { return json_answer(scene_of_gaussians(title_, gaussians_)); }
  Gaussians gaussians() const override { return gaussians_; }

 private:
  std::string title_;
  Gaussians gaussians_;
};

bool is_file_of_gaussians(const fs::path& path) {
  std::error_code error;
  if (fs::is_directory(path, error)) return false;
  const std::string extension = lower_case(path.extension().string());
  return fs::is_regular_file(path, error) || extension == ".ply" || extension == ".splat" || extension == ".spz" ||
         extension == ".glb" || extension == ".ksplat";
}

std::unique_ptr<Shown> shown_run(const ViewRequest& request, const Common& common, Events& events) {
  const RunRecord record = read_record(request.what);  // a wrong folder is told before a missing device
  check_has_views(record);
  const int log = request.log.empty() ? 0 : find_log(log_names(record), request.log);
  ViewedRun viewed{restored(request.what, common), log, fs::path(request.what).lexically_normal().string(),
                   request.prior, [prior = request.prior] { return prior_named(prior.empty() ? kShipped : prior); }};
  auto shown = std::make_unique<RunShown>(std::move(viewed), events);
  shown->warm_up();
  return shown;
}

void tell_address(const ViewServer& server, const Common& common) {
  if (common.json)
    put_json({{"schema_version", 1}, {"address", server.address()}, {"port", server.port()}});
  else
    put(server.address() + "\n");
  say(common, "open this address in a browser of this computer; Ctrl-C ends the viewer");
}

/// Where there is a desktop. A browser may stay in the foreground: nobody waits for it.
void open_browser(const std::string& address) {
  const fs::path opener = find_program("xdg-open");
  if (opener.empty() || (!std::getenv("DISPLAY") && !std::getenv("WAYLAND_DISPLAY"))) return;
  start_apart({opener, {address}});
}

int write_page(Shown& shown, const ViewRequest& request, const Common& common) {
  const StopOnSignal signals("finishing this picture");
  const std::uintmax_t bytes = write_view_html(request.html, shown, listener_of(common));
  if (common.json) put_json({{"schema_version", 1}, {"path", request.html}, {"bytes", bytes}});
  say(common, fmt::format("{}: {:.1f} MB; it opens in any browser, without this program and without a network",
                          request.html, 1e-6 * static_cast<double>(bytes)));
  return 0;
}

int run_view(const ViewRequest& request, const Common& common) {
  JobQueue jobs;
  Events events;
  std::unique_ptr<Shown> shown;
  if (is_file_of_gaussians(request.what))
    shown = std::make_unique<FileShown>(request.what);
  else
    shown = shown_run(request, common, events);
  if (!request.html.empty()) return write_page(*shown, request, common);
  const StopOnSignal signals("closing the viewer");
  ViewServer server(*shown, jobs, events, request.port);
  tell_address(server, common);
  if (!request.no_open) open_browser(server.address());
  jobs.stop_when([&] { return stop_signal.load() != 0 || server.was_asked_to_quit(); });
  jobs.run_until_stopped();
  return 0;
}

}  // namespace

Command add_view(CLI::App& program) {
  return command<ViewRequest>(program, "view", kViewExamples, run_view, [](const Options& add, ViewRequest& r) {
    add("RUN|FILE", r.what, "Run folder, or a file of Gaussians: .ply, .splat, .spz or .glb").required();
    add("--port", r.port, "Port of the address (one that is free)", whole_number(1, 65535));
    add("--no-open", r.no_open, "Do not open a browser");
    add("--html", r.html, "Write one HTML file that shows it without this program, and end", output_file());
    add("--log", r.log, "Runs on several logs: number (from 0) or name of the log to show (0)");
    add("--prior", r.prior, "Diffusion run that makes new assets (shipped)");
  });
}

}  // namespace cloam
