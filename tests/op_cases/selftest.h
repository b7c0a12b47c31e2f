// Runs the op rows on the chosen device: what cloam-selftest and `cloam selftest` print.
#pragma once
#include <iosfwd>

#include "tests/op_cases/op_cases.h"

namespace cloam {

struct SelftestRow {
  std::string name;
  CaseResult result;
};
using SelftestProgress = std::function<void(const SelftestRow& row, size_t done, size_t of)>;

/// Every row; quick leaves out the strided and the empty inputs. `progress` is called after each row and may be empty.
std::vector<SelftestRow> run_selftest(bool quick, const SelftestProgress& progress = {});

/// One line: verdict, name, worst errors, and what went wrong.
void print_row(std::ostream& out, const SelftestRow& row);
/// One JSON object: device, counts, rows.
void print_json(std::ostream& out, const std::vector<SelftestRow>& rows);

}  // namespace cloam
