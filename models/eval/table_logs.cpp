// See table_logs.h.
#include "models/eval/table_logs.h"

#include <algorithm>
#include <map>
#include <set>

#include "models/io/image.h"
#include "models/io/words.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

int64_t images_in(const fs::path& folder) {
  std::error_code error;
  int64_t count = 0;
  for (fs::recursive_directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error)) {
    if (entry->path().filename() == "truth") entry.disable_recursion_pending();
    count += is_image_name(entry->path());
  }
  return count;
}

/// Counted by names, since a plan must not read a hundred logs; in layouts without `camera/`, front images are guessed.
TableLog log_at(const fs::path& path) {
  std::error_code error;
  if (!fs::is_directory(path, error))
    throw Error(Fault::usage, text("there is no log ", path.string(), "\n  want folders of driving logs"));
  TableLog log{fs::canonical(path, error).string(), "", images_in(path), 0};
  log.name = fs::path(log.path).filename().string();
  log.front_images = images_in(path / "camera" / "front_camera");
  if (log.front_images == 0) log.front_images = log.images;
  if (log.images == 0) throw Error(Fault::data, path.string() + " holds no images: want a driving log");
  return log;
}

std::vector<TableLog> listed(const std::string& root, const std::string& list) {
  std::vector<TableLog> logs;
  for (const std::string& word : comma_separated(list)) {
    std::error_code error;
    const fs::path in_root = fs::path(root) / word;
    logs.push_back(log_at(!root.empty() && fs::is_directory(in_root, error) ? in_root : fs::path(word)));
  }
  return logs;
}

std::vector<std::string> folders_in(const std::string& root) {
  std::error_code error;
  std::vector<std::string> names;
  for (fs::directory_iterator entry(root, error), end; !error && entry != end; entry.increment(error))
    if (entry->is_directory(error)) names.push_back(entry->path().filename().string());
  if (names.empty())
    throw Error(Fault::usage, text(root, " holds no logs: want a folder of logs, such as PandaSet's 001, 002, ..."));
  std::sort(names.begin(), names.end());
  return names;
}

std::string measured_in(const std::vector<std::string>& names, const std::string& root) {
  for (const std::string& log : paper_logs())
    if (std::find(names.begin(), names.end(), log) == names.end())
      throw Error(Fault::usage, text(root, " has no log ", log, ", one of those that the paper measures (",
                                     joined(paper_logs()), ")\n  fix: say which are measured with --measure"));
  return joined(paper_logs(), ",");
}

/// The names of all but these.
std::string all_but(const std::vector<TableLog>& logs, const std::vector<std::string>& names) {
  std::vector<std::string> others;
  for (const std::string& name : names)
    if (std::none_of(logs.begin(), logs.end(), [&](const TableLog& log) { return log.name == name; }))
      others.push_back(name);
  return joined(others, ",");
}

/// Two logs of one name take their folder's in front.
void tell_apart(std::vector<TableLog>& logs) {
  std::map<std::string, int> count;
  for (const TableLog& log : logs) ++count[log.name];
  std::set<std::string> taken;
  for (TableLog& log : logs) {
    if (count[log.name] > 1) log.name = fs::path(log.path).parent_path().filename().string() + "-" + log.name;
    for (const std::string name = log.name; !taken.insert(log.name).second;) log.name = text(name, "-", taken.size());
  }
}

}  // namespace

const std::vector<std::string>& paper_logs() {
  static const std::vector<std::string> logs = {"001", "030", "040", "080", "090", "110", "120"};
  return logs;
}

TableLogs find_table_logs(const TableLogWish& wish) {
  if (wish.root.empty() && (wish.train.empty() || wish.measure.empty()))
    throw Error(Fault::usage,
                "the table needs logs: LOGS_ROOT, a folder that holds PandaSet's, or --train and --measure\n"
                "  --size small without --train makes those that train, and without --measure those that are measured");
  const std::vector<std::string> names = wish.root.empty() ? std::vector<std::string>() : folders_in(wish.root);
  TableLogs logs;
  logs.measured = listed(wish.root, wish.measure.empty() ? measured_in(names, wish.root) : wish.measure);
  const std::string train = wish.train.empty() ? all_but(logs.measured, names) : wish.train;
  if (train.empty())
    throw Error(Fault::usage, text(wish.root, ": all of its logs are measured; none is left to train"));
  logs.train = listed(wish.root, train);
  for (const TableLog& log : logs.train)
    for (const TableLog& other : logs.measured)
      if (log.path == other.path)
        throw Error(Fault::usage, text(log.path, " is to train and to be measured; name it in one list alone"));
  tell_apart(logs.measured);
  logs.photographs = logs.measured;
  return logs;
}

std::vector<TableLog> measured_table_logs(const TableLogWish& wish) {
  if (wish.measure.empty()) return {};
  std::vector<TableLog> logs = listed(wish.root, wish.measure);
  tell_apart(logs);
  return logs;
}

int64_t sparse_images(int64_t front_images) {
  const int64_t every = front_images >= 40 ? 10 : 5;
  return (front_images - 1) / every + 1 + ((front_images - 1) % every != 0);
}

}  // namespace cloam
