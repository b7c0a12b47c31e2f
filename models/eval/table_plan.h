// The paper's tables as a list of runs: which command makes what, from what. Data; nothing is run or read here.
#pragma once
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "models/eval/table_logs.h"
#include "models/eval/table_rows.h"

namespace cloam {

/// What a command of the list does: makes logs, cuts actors out of photographs, trains stage 1, fits a measured log
/// (with the networks of stage 1, or from nothing), learns the diffusion of assets, measures.
enum class TableWork { logs, crops, train, fit, assets, measure };

struct TableNode {
  std::string id;  // also its folder below the table's: "fit/full/1/001/sparse"
  TableWork work = TableWork::logs;
  std::vector<std::string> words = {};            // of the command; "@/" stands for the table's folder
  std::vector<std::string> needs = {};            // ids
  int64_t steps = 0;                              // of a training; pictures of a measurement, photographs of crops
  double seconds = 0;                             // expected on two cores
  std::string row = {}, log = {}, protocol = {};  // of a measurement; no log: generation
  int64_t seed = 0;
};

struct TableRequest {
  bool small = false;
  /// Without training logs: made ones, which are part of the list; likewise without measured ones.
  TableLogs logs;
  std::vector<TableRow> rows;
  std::vector<std::string> protocols;
  std::vector<int64_t> seeds = {1};
  std::string features = "random", perceptual = {};  // weights of feature networks: to measure by, to train by
  std::string lpips = {};                            // weights of LPIPS; empty: it is not measured
  std::map<std::string, int64_t> steps = {};         // of table_steps(), over the size's
  std::vector<std::string> settings = {};            // key=value for stage 1
};

struct TablePlan {
  TableRequest request;          // with the logs that are made
  std::vector<TableNode> nodes;  // each after those that it needs
};

/// Whether two commands may not run side by side: evaluations write into the run that they measure.
bool take_turns(const TableNode& one, const TableNode& other);

/// What steps can be given for: "train", "fit", "assets", "methods".
const std::vector<std::string>& table_steps();

/// Fault::usage where the request leaves nothing to measure.
TablePlan table_plan(const TableRequest& request);

}  // namespace cloam
