// cloam bench --merge: files of `bench --json`, of one device each, side by side.
#pragma once
#include <string>
#include <vector>

namespace cloam {

/// Markdown: the devices with their drivers and measured limits, then a row a workload with each device's median and
/// its share of that device's peak, and the geometric mean of each device's speed over the first one's. Workloads that
/// a file lacks are "-". Fault::data for a file that `bench --json` did not write, Fault::usage for none.
std::string merged_page(const std::vector<std::string>& files);

}  // namespace cloam
