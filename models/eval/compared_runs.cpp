// See compared_runs.h.
#include "models/eval/compared_runs.h"

#include <algorithm>
#include <cmath>

namespace cloam {
namespace {

using Report = nlohmann::ordered_json;

bool same_reading(const Reading& a, const Reading& b) {
  return a.downscale == b.downscale && a.holdout == b.holdout && a.protocol.name == b.protocol.name &&
         a.protocol.sparse_every == b.protocol.sparse_every && a.image == b.image && a.masks == b.masks &&
         a.actors == b.actors;
}

bool same_data(const RunRecord& a, const RunRecord& b) {
  const auto same = [](const RunData& x, const RunData& y) { return x.fingerprint == y.fingerprint; };
  return std::equal(a.data.begin(), a.data.end(), b.data.begin(), b.data.end(), same);
}

/// What neither seeds nor data differ in.
bool same_method(const ComparedRun& a, const ComparedRun& b) {
  const RunRecord &r = a.record, &s = b.record;
  return r.method == s.method && r.preset == s.preset && r.settings == s.settings && r.steps == s.steps &&
         same_reading(r.reading, s.reading) && word(a.eval, "protocol") == word(b.eval, "protocol") &&
         word(a.eval, "feature_network") == word(b.eval, "feature_network") &&
         word(a.eval, "perceptual_network") == word(b.eval, "perceptual_network");
}

}  // namespace

std::string word(const nlohmann::ordered_json& eval, const char* key) {
  const auto at = eval.find(key);
  return at == eval.end() || !at->is_string() ? "" : at->get<std::string>();
}

std::optional<double> figure(const nlohmann::ordered_json& eval, const char* key) {
  const auto at = eval.find(key);
  if (at == eval.end() || !at->is_number()) return {};
  return at->get<double>();
}

std::vector<RunGroup> groups_of(const std::vector<ComparedRun>& runs, bool across_data) {
  std::vector<RunGroup> groups;
  for (const ComparedRun& run : runs) {
    const auto fits = [&](const RunGroup& group) {
      const ComparedRun& first = *group.front();
      return same_method(first, run) && (across_data || same_data(first.record, run.record));
    };
    const auto group = std::find_if(groups.begin(), groups.end(), fits);
    group == groups.end() ? groups.push_back({&run}) : group->push_back(&run);
  }
  std::erase_if(groups, [](const RunGroup& group) { return group.size() < 2; });
  return groups;
}

std::optional<Mean> mean_of(const RunGroup& group, const char* key) {
  double sum = 0, squares = 0;
  for (const ComparedRun* run : group) {
    const auto value = figure(run->eval, key);
    if (!value) return {};
    sum += *value;
  }
  const double count = static_cast<double>(group.size()), mean = sum / count;
  for (const ComparedRun* run : group) squares += std::pow(*figure(run->eval, key) - mean, 2);
  return Mean{mean, std::sqrt(squares / (count - 1))};
}

nlohmann::ordered_json to_json(const std::vector<ComparedRun>& runs, const std::vector<RunGroup>& groups) {
  Report json = {{"schema_version", 1}, {"runs", Report::array()}, {"means", Report::array()}};
  const auto head = [](const ComparedRun& run) {
    Report row = {{"method", run.record.method}, {"preset", run.record.preset}, {"protocol", run.eval["protocol"]}};
    for (const char* network : {"feature_network", "perceptual_network"})
      if (run.eval.contains(network)) row[network] = run.eval[network];
    return row;
  };
  for (const ComparedRun& run : runs) {
    Report row = {{"run", run.run}, {"seed", run.record.seed}, {"steps", run.eval["step"]}};
    row.update(head(run));
    for (const ComparedFigure& column : kComparedFigures)
      if (run.eval.contains(column.key)) row[column.key] = run.eval[column.key];
    json["runs"].push_back(row);
  }
  for (const RunGroup& group : groups) {
    Report row = head(*group.front());
    for (const ComparedRun* run : group) row["seeds"].push_back(run->record.seed);
    for (const ComparedFigure& column : kComparedFigures)
      if (const auto value = mean_of(group, column.key))
        row[column.key] = {{"mean", value->mean}, {"deviation", value->deviation}};
    json["means"].push_back(row);
  }
  return json;
}

}  // namespace cloam
