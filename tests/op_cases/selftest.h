// Runs the op rows on the chosen device: what cloam-selftest and `cloam selftest` print.
#pragma once
#include <iosfwd>
#include <set>

#include "runtime/verdict.h"
#include "tests/op_cases/op_cases.h"

namespace cloam {

struct SelftestRow {
  std::string name;
  CaseResult result;
  std::set<std::string> kernels = {};   // that it launched
  std::set<std::string> families = {};  // of kernels, where there was a choice of variants
  std::string mended_by = {};           // the family whose reference gets the row right, where its variants do not
};
using SelftestProgress = std::function<void(const SelftestRow& row, size_t done, size_t of)>;

/// A kernel that may be to blame: how many rows that launch it failed, and how many passed.
struct Suspect {
  std::string kernel;
  int failed = 0, passed = 0;
};

struct SelftestReport {
  std::vector<SelftestRow> rows;       // op rows; not quick: then one a variant that is not the built-in choice
  std::vector<Suspect> suspects = {};  // most suspicious first; empty when all is well
  Verdict verdict = {};                // without the date
  bool all_passed() const;
};

struct SelftestWish {
  bool quick = false;             // leaves out strided and empty inputs, and variants that are not the built-in choice
  std::vector<std::string> only;  // parts of the names of the rows to run; empty: all
};

/// Every row with the built-in variants; rows that fail once more with references in their place, one family after
/// another. `progress` is called after each row and may be empty. What was switched off before serves again meanwhile;
/// afterwards what the verdict says is switched off. Fault::usage where no row has the name.
SelftestReport run_selftest(const SelftestWish& wish, const SelftestProgress& progress = {});

/// One line: verdict, name, worst errors, and what went wrong.
void print_row(std::ostream& out, const SelftestRow& row);
/// What is to be known beyond the rows: families switched off, suspects. Nothing when all is well.
void print_findings(std::ostream& out, const SelftestReport& report);
/// One JSON object: device, counts, rows.
void print_json(std::ostream& out, const SelftestReport& report);
/// Markdown for a bug report: device, driver, limits, verdict, and every row that failed.
void print_markdown(std::ostream& out, const SelftestReport& report);

}  // namespace cloam
