// cloam selftest: does this device compute right? Every op and gradient against float64 on the host.
#include "tests/op_cases/selftest.h"

#include <algorithm>
#include <cstdio>
#include <sstream>

#include "cli/commands.h"
#include "models/io/commit.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr char kSelftestExamples[] =
    R"(Compare every operation on the device with float64 on the host. What is found is kept:
cloam info shows it, and a device that computes wrong results is refused from then on.

Examples:
  cloam selftest --quick
  cloam selftest --device gpu
  cloam selftest --only conv2d
  cloam selftest --report            # Markdown, for a bug report
  cloam selftest --json > selftest.json)";

struct SelftestRequest {
  SelftestWish wish;
  bool report = false;
};

template <class Print, class What>
std::string printed(const Print& print, const What& what) {
  std::ostringstream out;
  print(out, what);
  return out.str();
}

std::string worst_of(const std::vector<SelftestRow>& rows) {
  const auto error = [](const SelftestRow& row) {
    return std::max(row.result.forward_error, row.result.gradient_error);
  };
  const auto worst = std::max_element(rows.begin(), rows.end(),
                                      [&](const SelftestRow& a, const SelftestRow& b) { return error(a) < error(b); });
  return worst == rows.end() ? "" : text("; worst error ", error(*worst), " (", worst->name, ")");
}

/// A folder that cannot be written loses the verdict, not the test.
void keep(Verdict verdict) {
  verdict.when = time_stamp();
  try {
    commit_text(verdict_file(device()), file_text(verdict, device()));
  } catch (const Error& error) {
    warn(text("the result is not kept for later runs: ", error.what(),
              "\n  fix: set CLOAM_CACHE_DIR to another folder"));
  }
}

int run_selftest_command(const SelftestRequest& request, const Common& common) {
  open_any_device(common);
  say(common, text("device ", device().name, " (", device().platform, "); to select it: ", device_spelling(device())));
  const bool lines = !common.json && !request.report;
  const SelftestReport report = run_selftest(request.wish, [&](const SelftestRow& row, std::size_t, std::size_t) {
    const bool shown = !row.result.passed || !common.quiet;
    if (lines && shown) put(printed(print_row, row));
  });
  if (request.wish.only.empty()) keep(report.verdict);
  if (lines) put(printed(print_findings, report));
  if (common.json) put(printed(print_json, report));
  if (request.report) put(printed(print_markdown, report));
  const auto& rows = report.rows;
  const auto passed = std::count_if(rows.begin(), rows.end(), [](const SelftestRow& row) { return row.result.passed; });
  say(common, text(passed, " of ", rows.size(), " rows agree with float64", worst_of(rows)));
  if (!report.verdict.passed() && request.wish.only.empty())
    say(common,
        "this device computes wrong results: other commands refuse it from now on (--force uses it all the same)");
  return report.all_passed() ? 0 : static_cast<int>(Fault::verification);
}

}  // namespace

Command add_selftest(CLI::App& program) {
  return command<SelftestRequest>(
      program, "selftest", kSelftestExamples, run_selftest_command, [](const Options& add, SelftestRequest& r) {
        add("--only", r.wish.only, "Only rows whose names contain one of these; the result is not kept");
        add("--quick", r.wish.quick, "Test dense inputs and the built-in kernel variants only");
        add("--report", r.report, "Print Markdown for a bug report: device, limits, and what failed");
      });
}

}  // namespace cloam
