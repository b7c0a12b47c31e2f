// What each workload must reach beside its best peer, and what it should: ratios of time, the peer's over ours.
#pragma once
#include <string>
#include <vector>

namespace cloam {

struct Floor {
  std::string name;  // of a workload, or NAME@way for one way of a peer that has a row to itself
  double floor = 0, reach = 0;
  bool milliseconds = false;  // no ratio: our own time, at most
};
/// Null for workloads of which nothing is demanded.
const Floor* floor_of(const std::string& name);

}  // namespace cloam
