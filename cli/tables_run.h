// Runs a table's list of commands, goes on where it was left, and writes figures and page.
#pragma once
#include "cli/common.h"
#include "models/eval/table_state.h"

namespace cloam {

/// jobs: commands side by side, each with its share of the cores. Returns 0 when all is measured. Interrupted after a
/// signal. An Error with the fault of the first command that failed, once all others are done. Fault::write.
int run_tables(const TableFolder& folder, const TablePlan& plan, int jobs, const Common& common);

}  // namespace cloam
