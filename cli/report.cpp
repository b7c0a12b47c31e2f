// cloam report: one page on a run.
#include <nlohmann/json.hpp>

#include "cli/commands.h"
#include "cli/curves.h"
#include "cli/report_page.h"
#include "cli/run_pictures.h"
#include "cli/stop_signal.h"
#include "cli/terminal_picture.h"
#include "models/runs/run_folder.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr double kPictureSeconds = 30;  // for those that are missing
constexpr char kReportExamples[] =
    R"(Write one page on a run: what it learned from, curves, pictures, metrics, and how to reproduce it.

Examples:
  cloam report runs/fox                              runs/fox/report.html
  cloam report runs/fox -o fox.html
  cloam report runs/fox --pictures off               from what is there: needs no device
  cloam report runs/fox --show                       and the newest preview in the terminal

The page is one file that holds its pictures; it can be mailed. A training writes it at its end. This command also makes
the turntable, the drive and the sheet of assets if they are missing. Evaluate first (cloam eval) to see metrics.)";

struct ReportRequest {
  std::string run, out, show, pictures = "on";
};

/// Whether the folder lacks the pictures that make_pictures makes.
bool lacks_pictures(const fs::path& run) {
  std::error_code error;
  return !fs::exists(RunPaths{run}.turntable(), error) && !fs::exists(RunPaths{run}.drive(), error);
}

/// The page is worth having without them: a device that fails is told and no reason to end.
void add_pictures(const ReportRequest& request, const Common& common) {
  const StopOnSignal signals("finishing this picture");
  RestoredRun run = restored(request.run, common);
  say(common, "rendering the run's pictures");
  make_pictures(run, kPictureSeconds, common);
}

int run_report(ReportRequest request, const Common& common) {
  const RunRecord record = read_record(request.run);
  if (request.out.empty()) request.out = RunPaths{request.run}.report().string();
  if (request.pictures == "on" && record.state != "running" && lacks_pictures(request.run))
    add_pictures(request, common);
  write_curves(request.run);
  write_report_page(request.run, request.out);
  if (common.json) put_json({{"schema_version", 1}, {"report", request.out}});
  say(common, "the report is " + request.out);
  const fs::path picture = main_picture(request.run);
  if (!picture.empty()) show_picture(request.show, picture, common);
  return 0;
}

}  // namespace

Command add_report(CLI::App& program) {
  return command<ReportRequest>(
      program, "report", kReportExamples, run_report, [](const Options& add, ReportRequest& r) {
        add("RUN", r.run, "Run folder").required();
        add("-o,--out", r.out, "The page (RUN/report.html)");
        add("--pictures", r.pictures, "on: make those that are missing; off: only what is there (on)",
            one_of({"on", "off"}));
        add_show(add, r.show);
      });
}

}  // namespace cloam
