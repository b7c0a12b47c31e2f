// Runs the op rows on the chosen device, finds what is to blame where they fail, and prints what came out.
#include "tests/op_cases/selftest.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iomanip>
#include <map>
#include <ostream>
#include <utility>

#include "runtime/device.h"
#include "runtime/error.h"
#include "runtime/nearest_name.h"
#include "tests/op_cases/candidates.h"

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

Thorough thorough(bool quick) { return quick ? Thorough::quick : Thorough::full; }

SelftestRow checked(const OpCase& row, bool quick) {
  SelftestRow out{row.name(), {}};
  record_kernels(&out.kernels);
  const std::vector<Choice> choices = choices_of([&] { out.result = check(row, thorough(quick)); });
  record_kernels(nullptr);
  for (const Choice& choice : choices) out.families.insert(choice.family);
  return out;
}

/// Families that a row may be mended by: those it chose from, and those that these are a special case of (conv2d_small
/// of conv2d), which may hold the reference.
std::vector<std::string> families_to_try(const SelftestRow& row) {
  std::set<std::string> names = row.families;
  for (const std::string& family : row.families) names.insert(family.substr(0, family.find('_')));
  return {names.begin(), names.end()};
}

/// Switches off one more family if that gets the row right. A row that another one's family mends is left as it is.
void mend(SelftestRow& row, const OpCase& of, bool quick, std::vector<std::string>& off) {
  if (!off.empty() && check(of, thorough(quick)).passed) {
    row.mended_by = off.back();
    return;
  }
  for (const std::string& family : families_to_try(row)) {
    if (std::find(off.begin(), off.end(), family) != off.end()) continue;
    off.push_back(family);
    switch_off(off);
    if (check(of, thorough(quick)).passed) {
      row.mended_by = family;
      return;
    }
    off.pop_back();
    switch_off(off);
  }
}

/// How much a kernel's rows fail (Ochiai's coefficient, of fault localisation): 1 if all failing rows launch it and no
/// passing one.
double suspicion(const Suspect& s, int all_failed) {
  return s.failed / std::sqrt(static_cast<double>(all_failed) * (s.failed + s.passed));
}

std::vector<Suspect> suspects_of(const std::vector<SelftestRow>& rows) {
  constexpr size_t kShown = 5;
  std::map<std::string, Suspect> all;
  int failed = 0;
  for (const SelftestRow& row : rows) {
    failed += !row.result.passed;
    for (const std::string& kernel : row.kernels) {
      Suspect& suspect = all[kernel];
      suspect.kernel = kernel;
      (row.result.passed ? suspect.passed : suspect.failed)++;
    }
  }
  std::vector<Suspect> out;
  for (const auto& [name, suspect] : all)
    if (suspect.failed > 0) out.push_back(suspect);
  std::stable_sort(out.begin(), out.end(),
                   [&](const Suspect& a, const Suspect& b) { return suspicion(a, failed) > suspicion(b, failed); });
  if (out.size() > kShown) out.resize(kShown);
  return out;
}

/// Variants that `tune` might choose: each must pass the rows of its place with the bits of the built-in one.
void check_variants(SelftestReport& report, const SelftestProgress& progress) {
  const RowsByPlace rows = rows_by_choice();
  for (const auto& [place, of] : rows)
    for (const Variant* variant : candidates(place.first, place.second)) {
      if (variant == candidates(place.first, place.second)[0]) continue;
      CaseResult result;
      result.worst = reject(place, *variant, rows);
      result.passed = result.worst.empty();
      report.rows.push_back({text("variant ", place.first, ": ", variant->row()), result});
      if (progress) progress(report.rows.back(), report.rows.size(), report.rows.size());
    }
}

Verdict verdict_from(const std::vector<SelftestRow>& rows, bool quick) {
  Verdict out;
  out.quick = quick;
  out.rows = static_cast<int>(rows.size());
  for (const SelftestRow& row : rows) {
    if (row.result.passed) continue;
    const auto same = [&](const SwitchedOff& known) { return known.family == row.mended_by; };
    if (row.mended_by.empty())
      out.failed.push_back(row.name);
    else if (std::none_of(out.off.begin(), out.off.end(), same))
      out.off.push_back({row.mended_by, row.name});
  }
  return out;
}

/// All rows, or those whose name contains one of `parts`.
std::vector<const OpCase*> rows_named(const std::vector<std::string>& parts) {
  std::vector<const OpCase*> rows;
  for (const OpCase& row : op_cases()) {
    const auto named = [&](const std::string& part) { return row.name().find(part) != std::string::npos; };
    if (parts.empty() || std::any_of(parts.begin(), parts.end(), named)) rows.push_back(&row);
  }
  if (rows.empty()) {
    std::vector<std::string> ops;
    for (const OpCase& row : op_cases()) ops.push_back(row.op);
    throw Error(Fault::usage, text("no op row's name contains \"", parts[0], "\"", did_you_mean(parts[0], ops),
                                   "\n  fix: name an op, such as conv2d; without --only all are tested"));
  }
  return rows;
}

}  // namespace

bool SelftestReport::all_passed() const {
  return std::all_of(rows.begin(), rows.end(), [](const SelftestRow& row) { return row.result.passed; });
}

SelftestReport run_selftest(const SelftestWish& wish, const SelftestProgress& progress) {
  const std::vector<const OpCase*> wanted = rows_named(wish.only);
  SelftestReport report;
  std::vector<std::string> off;
  switch_off(off);
  for (const OpCase* row : wanted) {
    report.rows.push_back(checked(*row, wish.quick));
    if (progress) progress(report.rows.back(), report.rows.size(), wanted.size());
  }
  if (!report.all_passed()) report.suspects = suspects_of(report.rows);
  for (size_t i = 0; i < wanted.size(); i++)
    if (!report.rows[i].result.passed) mend(report.rows[i], *wanted[i], wish.quick, off);
  report.verdict = verdict_from(report.rows, wish.quick);
  if (!wish.quick && wish.only.empty() && report.verdict.passed()) check_variants(report, progress);
  return report;
}

void print_row(std::ostream& out, const SelftestRow& row) {
  const CaseResult& r = row.result;
  out << (r.passed ? "ok    " : "FAIL  ") << std::left << std::setw(40) << row.name << std::scientific
      << std::setprecision(1) << "  value " << r.forward_error << "  gradient " << r.gradient_error;
  if (!r.passed) out << "  " << r.worst;
  out << "\n";
}

void print_findings(std::ostream& out, const SelftestReport& report) {
  for (const SwitchedOff& off : report.verdict.off)
    out << "switched off: the faster kernels of " << off.family << ", which are wrong in row \"" << off.op_row
        << "\" where the reference is right\n";
  for (const Suspect& suspect : report.suspects)
    out << "suspect: " << suspect.kernel << " (" << suspect.failed << " rows that launch it failed, " << suspect.passed
        << " passed)\n";
}

void print_json(std::ostream& out, const SelftestReport& report) {
  const auto failed =
      std::count_if(report.rows.begin(), report.rows.end(), [](const SelftestRow& row) { return !row.result.passed; });
  out << "{\"schema_version\": 1, \"device\": " << quoted(device().name) << ", \"driver\": " << quoted(device().driver)
      << ", \"rows\": " << report.rows.size() << ", \"failed\": " << failed
      << ", \"usable\": " << (report.verdict.passed() ? "true" : "false") << ", \"switched_off\": [";
  for (size_t i = 0; i < report.verdict.off.size(); i++)
    out << (i ? ", " : "") << "{\"family\": " << quoted(report.verdict.off[i].family)
        << ", \"row\": " << quoted(report.verdict.off[i].op_row) << "}";
  out << "], \"suspects\": [";
  for (size_t i = 0; i < report.suspects.size(); i++)
    out << (i ? ", " : "") << "{\"kernel\": " << quoted(report.suspects[i].kernel)
        << ", \"failed\": " << report.suspects[i].failed << ", \"passed\": " << report.suspects[i].passed << "}";
  out << "], \"results\": [";
  for (size_t i = 0; i < report.rows.size(); i++) {
    const CaseResult& r = report.rows[i].result;
    out << (i ? ",\n" : "\n") << "  {\"name\": " << quoted(report.rows[i].name)
        << ", \"passed\": " << (r.passed ? "true" : "false") << ", \"value_error\": " << finite(r.forward_error)
        << ", \"gradient_error\": " << finite(r.gradient_error) << ", \"worst\": " << quoted(r.worst) << "}";
  }
  out << "\n]}\n";
}

void print_markdown(std::ostream& out, const SelftestReport& report) {
  const DeviceInfo& d = device();
  const auto failed =
      std::count_if(report.rows.begin(), report.rows.end(), [](const SelftestRow& row) { return !row.result.passed; });
  out << "### selftest of " << d.name << "\n\n| | |\n|---|---|\n| platform | " << d.platform << " |\n| driver | "
      << d.driver << " |\n| OpenCL | " << d.cl_version << " |\n| type, class | " << (d.is_cpu ? "cpu" : "gpu") << ", "
      << (d.device_class == DeviceClass::cpu ? "cpu" : "gpu") << " |\n| compute units | " << d.compute_units
      << " |\n| work-group | " << d.max_work_group << " |\n| local memory | " << (d.local_bytes >> 10)
      << " KiB |\n| global memory, largest buffer | " << (d.global_bytes >> 20) << ", " << (d.max_alloc_bytes >> 20)
      << " MiB |\n| rows | " << report.rows.size() << ", " << failed << " failed |\n\n";
  if (report.all_passed()) return;
  out << "```\n";
  for (const SelftestRow& row : report.rows)
    if (!row.result.passed) print_row(out, row);
  print_findings(out, report);
  out << "```\n";
}

}  // namespace cloam
