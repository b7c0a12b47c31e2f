// cloam selftest: does this device compute right? Every op and gradient against float64 on the host.
#include "tests/op_cases/selftest.h"

#include <algorithm>
#include <cstdio>
#include <sstream>

#include "cli/commands.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr char kExamples[] = R"(Compare every operation on the device with float64 on the host.

Examples:
  cloam selftest --quick
  cloam selftest --device gpu
  cloam selftest --json > selftest.json)";

std::string line_of(const SelftestRow& row) {
  std::ostringstream line;
  print_row(line, row);
  return line.str();
}

std::string worst_of(const std::vector<SelftestRow>& rows) {
  const auto error = [](const SelftestRow& row) {
    return std::max(row.result.forward_error, row.result.gradient_error);
  };
  const auto worst = std::max_element(rows.begin(), rows.end(),
                                      [&](const SelftestRow& a, const SelftestRow& b) { return error(a) < error(b); });
  return worst == rows.end() ? "" : text("; worst error ", error(*worst), " (", worst->name, ")");
}

int run_command(bool quick, const Common& common) {
  open_device(common);
  say(common, text("device ", device().name, " (", device().platform, "); to select it: ", device_spelling(device())));
  const std::vector<SelftestRow> rows = run_selftest(quick, [&](const SelftestRow& row, std::size_t, std::size_t) {
    const bool shown = !row.result.passed || !common.quiet;
    if (!common.json && shown) put(line_of(row));
  });
  std::ostringstream json;
  print_json(json, rows);
  if (common.json) put(json.str());
  const auto passed = std::count_if(rows.begin(), rows.end(), [](const SelftestRow& row) { return row.result.passed; });
  say(common, text(passed, " of ", rows.size(), " rows agree with float64", worst_of(rows)));
  return passed == static_cast<std::ptrdiff_t>(rows.size()) ? 0 : static_cast<int>(Fault::verification);
}

}  // namespace

Command add_selftest(CLI::App& program) {
  return command<bool>(program, "selftest", kExamples, run_command,
                       [](const Options& add, bool& quick) { add("--quick", quick, "Test dense inputs only"); });
}

}  // namespace cloam
