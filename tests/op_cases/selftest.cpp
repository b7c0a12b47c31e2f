// Runs the op rows on the chosen device and prints what came out.
#include "tests/op_cases/selftest.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iomanip>
#include <ostream>

#include "runtime/device.h"

namespace cloam {
namespace {

std::string quoted(const std::string& plain) {
  std::string out = "\"";
  for (char c : plain) {
    char code[8];
    std::snprintf(code, sizeof code, "\\u%04x", static_cast<unsigned char>(c));
    if (c == '"' || c == '\\')
      out += std::string("\\") + c;
    else if (static_cast<unsigned char>(c) < 32)
      out += code;
    else
      out += c;
  }
  return out + "\"";
}

/// JSON has no infinity.
double finite(double error) { return std::isfinite(error) ? error : 1e308; }

}  // namespace

std::vector<SelftestRow> run_selftest(bool quick, const SelftestProgress& progress) {
  std::vector<SelftestRow> rows;
  for (const OpCase& row : op_cases()) {
    rows.push_back({row.name(), check(row, quick ? Thorough::quick : Thorough::full)});
    if (progress) progress(rows.back(), rows.size(), op_cases().size());
  }
  return rows;
}

void print_row(std::ostream& out, const SelftestRow& row) {
  const CaseResult& r = row.result;
  out << (r.passed ? "ok    " : "FAIL  ") << std::left << std::setw(40) << row.name << std::scientific
      << std::setprecision(1) << "  value " << r.forward_error << "  gradient " << r.gradient_error;
  if (!r.passed) out << "  " << r.worst;
  out << "\n";
}

void print_json(std::ostream& out, const std::vector<SelftestRow>& rows) {
  const auto failed =
      std::count_if(rows.begin(), rows.end(), [](const SelftestRow& row) { return !row.result.passed; });
  out << "{\"schema_version\": 1, \"device\": " << quoted(device().name) << ", \"driver\": " << quoted(device().driver)
      << ", \"rows\": " << rows.size() << ", \"failed\": " << failed << ", \"results\": [";
  for (size_t i = 0; i < rows.size(); i++) {
    const CaseResult& r = rows[i].result;
    out << (i ? ",\n" : "\n") << "  {\"name\": " << quoted(rows[i].name)
        << ", \"passed\": " << (r.passed ? "true" : "false") << ", \"value_error\": " << finite(r.forward_error)
        << ", \"gradient_error\": " << finite(r.gradient_error) << ", \"worst\": " << quoted(r.worst) << "}";
  }
  out << "\n]}\n";
}

}  // namespace cloam
