// The driving logs of the paper's tables: which train and which are measured.
#pragma once
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace cloam {

struct TableLog {
  std::string path;  // absolute; "@/..." is in the table's folder
  std::string name;  // of its folder; different from those of the others
  int64_t images = 0, front_images = 0;
};

struct TableLogs {
  std::vector<TableLog> train, measured;
  std::vector<TableLog> photographs =
      {};  // whose actors generated ones are held against: with masks, as far as there are
};

/// What the user says: a folder of logs, and lists of folders or of names in it.
struct TableLogWish {
  std::string root, train, measure;  // lists with commas; empty: not given
};

/// PandaSet's logs that the paper measures; it trains on all others.
const std::vector<std::string>& paper_logs();

/// Without lists: the root's paper_logs() are measured, its other logs train. Fault::usage, Fault::data for what is not
/// there, and for a log in both lists.
TableLogs find_table_logs(const TableLogWish& wish);
/// Those of wish.measure alone; none where it is empty.
std::vector<TableLog> measured_table_logs(const TableLogWish& wish);

/// How many of so many front images `sparse` trains on (split.h).
int64_t sparse_images(int64_t front_images);

}  // namespace cloam
