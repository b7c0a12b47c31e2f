// The paper's tables as a page for people: figures, pictures of held-out images, and the commands that were run.
#pragma once
#include <string>
#include <vector>

#include "models/eval/table_figures.h"
#include "models/eval/table_state.h"

namespace cloam {

/// A command that failed, or that was left out because one that it needs did.
struct TableTrouble {
  std::string id, error;
};

/// Writes folder.page() and the pictures that it shows. Fault::data for pictures that are damaged; Fault::write.
void write_tables_page(const TableFolder& folder, const TablePlan& plan, const TableFigures& figures,
                       const std::vector<TableTrouble>& failed, const std::vector<TableTrouble>& left_out);

}  // namespace cloam
