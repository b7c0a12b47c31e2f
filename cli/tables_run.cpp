// See tables_run.h.
#include "cli/tables_run.h"

#include <algorithm>
#include <chrono>
#include <csignal>
#include <map>
#include <nlohmann/json.hpp>
#include <thread>

#include "cli/child_program.h"
#include "cli/commands.h"
#include "cli/progress.h"
#include "cli/stop_signal.h"
#include "cli/tables_page.h"
#include "models/io/bytes.h"
#include "models/io/commit.h"
#include "models/runs/run_folder.h"
#include "runtime/error.h"

namespace cloam {
namespace {

using Words = std::vector<std::string>;
using Clock = std::chrono::steady_clock;

constexpr char kOurselves[] = "/proc/self/exe";  // also after the file was replaced by a new build
constexpr uint64_t kLargestFigures = 256 << 20;
constexpr std::size_t kLineWidth = 100;

bool is_training(const TableNode& node) {
  return node.work == TableWork::train || node.work == TableWork::fit || node.work == TableWork::assets;
}

/// The fault of a command that ended so. A kill from outside is most often that of a system without memory.
Fault fault_of(int code) {
  if (code == -SIGKILL) return Fault::memory;
  return code >= 2 && code <= 8 ? static_cast<Fault>(code) : Fault::internal;
}

void remove_folder(const fs::path& folder) {
  std::error_code error;
  fs::remove_all(folder, error);
  if (error) throw Error(Fault::write, text(folder.string(), ": cannot be removed: ", error.message()));
}

/// After a kill the command that ran dies with the table, but not in the same instant.
void wait_until_free(const fs::path& run) {
  constexpr int kLooks = 100;
  for (int look = 0; look < kLooks && fs::exists(run); ++look) {
    try {
      const FolderLock lock(run);
      return;
    } catch (const Error&) { std::this_thread::sleep_for(std::chrono::milliseconds(100)); }
  }
}

class TableRun {
 public:
  TableRun(const TableFolder& folder, const TablePlan& plan, const Common& common)
      : folder_(folder), plan_(plan), common_(common) {}

  int run();

 private:
  enum class State { done, failed, left_out };

  State advance(const TableNode& node, std::size_t number);
  State run_command(const TableNode& node);
  Words words_of(const TableNode& node, bool resumes) const;
  ChildEnd run_child_of(const TableNode& node, const Words& words);
  void keep_figures(const TableNode& node) const;
  void fail(const TableNode& node, NodeRecord record, int code, const std::string& error);
  void write_results();
  nlohmann::ordered_json told() const;
  std::size_t done() const;

  const TableFolder& folder_;
  const TablePlan& plan_;
  const Common& common_;
  std::map<std::string, State> states_;
  std::vector<TableTrouble> failed_, left_out_;
  std::string said_error_;  // of the command that runs
  Fault first_fault_ = Fault::internal;
  nlohmann::ordered_json tables_;
};

/// A training that has a checkpoint goes on; all else begins anew.
Words TableRun::words_of(const TableNode& node, bool resumes) const {
  Words words = {"train", "--resume", folder_.of(node).string()};
  if (!resumes) {
    words.clear();
    for (const std::string& word : node.words) words.push_back(folder_.word(word));
  }
  if (is_training(node)) words.insert(words.end(), {"--progress", "plain"});
  if (common_.device != Common().device) words.insert(words.end(), {"--device", common_.device});
  if (!common_.max_memory.empty()) words.insert(words.end(), {"--max-memory", common_.max_memory});
  return words;
}

ChildEnd TableRun::run_child_of(const TableNode& node, const Words& words) {
  said_error_.clear();
  RewrittenLine line(common_);
  return run_child({kOurselves, words}, [&](const std::string& said) {
    if (said.starts_with("error: ")) said_error_ = said;
    if (common_.verbose) say(common_, said);
    if (!common_.verbose && line.on_terminal()) line.draw((node.id + "  " + said).substr(0, kLineWidth));
  });
}

/// An evaluation writes into the run, where that of the next protocol takes its place.
void TableRun::keep_figures(const TableNode& node) const {
  if (node.work != TableWork::measure) return;
  const fs::path run = folder_.word(node.words.at(1));
  const auto bytes = read_file(RunPaths{run}.eval() / "eval.json", kLargestFigures);
  commit_text(folder_.figures(node), std::string(bytes.begin(), bytes.end()));
}

void TableRun::fail(const TableNode& node, NodeRecord record, int code, const std::string& error) {
  record.state = "failed";
  record.error = error;
  write_node(folder_, node, record);
  if (failed_.empty()) first_fault_ = fault_of(code);
  failed_.push_back({node.id, error});
  warn(node.id + " failed: " + error);
}

TableRun::State TableRun::run_command(const TableNode& node) {
  NodeRecord record{"running", node.words, {}, {}};
  const bool begun = read_node(folder_, node).has_value();
  if (begun && is_training(node)) wait_until_free(folder_.of(node));
  const bool resumes =
      begun && is_training(node) && fs::exists(RunPaths{folder_.of(node)}.checkpoints() / "latest.txt");
  if (!resumes) remove_folder(folder_.of(node));
  write_node(folder_, node, record);
  const Clock::time_point start = Clock::now();
  const ChildEnd end = run_child_of(node, words_of(node, resumes));
  if (end.code != 0 && stop_signal.load() != 0) return State::failed;  // asked to stop: neither done nor failed
  if (end.code != 0) {
    fail(node, record, end.code, said_error_.empty() ? end.in_words() : said_error_);
    return State::failed;
  }
  keep_figures(node);
  record.state = "done";
  if (!resumes) record.seconds = std::chrono::duration<double>(Clock::now() - start).count();
  write_node(folder_, node, record);
  if (is_done(folder_, node)) return State::done;
  fail(node, record, 1, "the command ended well, but what it was to make is not there");
  return State::failed;
}

TableRun::State TableRun::advance(const TableNode& node, std::size_t number) {
  for (const std::string& need : node.needs) {
    if (states_.at(need) == State::done) continue;
    left_out_.push_back({node.id, "needs " + need});
    return State::left_out;
  }
  if (is_done(folder_, node)) return State::done;
  say(common_, text("[", number, "/", plan_.nodes.size(), "] ", node.id, "; ",
                    words_for_seconds(seconds_left(folder_, plan_)), " left in total"));
  return run_command(node);
}

std::size_t TableRun::done() const {
  return static_cast<std::size_t>(std::count_if(plan_.nodes.begin(), plan_.nodes.end(),
                                                [&](const TableNode& node) { return is_done(folder_, node); }));
}

void TableRun::write_results() {
  const TableFigures figures = table_figures(plan_, [&](const TableNode& node) {
    return is_done(folder_, node) ? read_figures(folder_, node) : std::nullopt;
  });
  tables_ = to_json(figures, plan_);
  commit_text(folder_.json(), tables_.dump(2) + "\n");
  commit_text(folder_.markdown(), to_markdown(figures, plan_));
  write_tables_page(folder_, plan_, figures, failed_, left_out_);
}

nlohmann::ordered_json TableRun::told() const {
  const auto list = [](const std::vector<TableTrouble>& troubles, const char* key) {
    auto json = nlohmann::ordered_json::array();
    for (const TableTrouble& trouble : troubles) json.push_back({{"id", trouble.id}, {key, trouble.error}});
    return json;
  };
  return {{"schema_version", 1}, {"page", folder_.page().string()},  {"commands", plan_.nodes.size()},
          {"done", done()},      {"failed", list(failed_, "error")}, {"left_out", list(left_out_, "why")},
          {"tables", tables_}};
}

int TableRun::run() {
  const FolderLock lock(folder_.root);
  fs::create_directories(folder_.root / "nodes");  // from here on the folder is known as a table's
  const StopOnSignal signals("ending the command that runs; a training saves its step");
  for (std::size_t i = 0; i < plan_.nodes.size() && stop_signal.load() == 0; ++i)
    states_[plan_.nodes[i].id] = advance(plan_.nodes[i], i + 1);
  write_results();
  check_stop([&] {
    return text(done(), " of ", plan_.nodes.size(), " commands are done in ", folder_.root.string(),
                "; the same command goes on");
  });
  if (common_.json) put_json(told(), 2);
  say(common_, text("tables ", folder_.markdown().string(), ", page ", folder_.page().string()));
  if (failed_.empty()) return 0;
  std::string lines;
  for (const TableTrouble& trouble : failed_) lines += "\n  " + trouble.id + ": " + trouble.error;
  throw Error(first_fault_, text(failed_.size(), " of ", plan_.nodes.size(), " commands failed, and ", left_out_.size(),
                                 " that need them were left out; the same command tries them again", lines));
}

}  // namespace

int run_tables(const TableFolder& folder, const TablePlan& plan, const Common& common) {
  return TableRun(folder, plan, common).run();
}

}  // namespace cloam
