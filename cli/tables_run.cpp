// See tables_run.h.
#include "cli/tables_run.h"

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <csignal>
#include <cstdlib>
#include <map>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <thread>
#include <utility>

#include "cli/child_program.h"
#include "cli/commands.h"
#include "cli/failure.h"
#include "cli/progress.h"
#include "cli/ranks.h"
#include "cli/stop_signal.h"
#include "cli/tables_page.h"
#include "models/io/bytes.h"
#include "models/io/commit.h"
#include "models/runs/run_folder.h"
#include "runtime/device.h"
#include "runtime/error.h"

namespace cloam {
namespace {

using Words = std::vector<std::string>;
using Report = nlohmann::ordered_json;
using Clock = std::chrono::steady_clock;

constexpr char kOurselves[] = "/proc/self/exe";  // also after the file was replaced by a new build
constexpr uint64_t kLargestFigures = 256 << 20;
constexpr std::size_t kLineWidth = 100;
constexpr auto kLook = std::chrono::milliseconds(200);  // from one exchange of news between ranks to the next

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

/// Each of N commands gets 1/N of the cores as PoCL workers. They are not pinned: the workers of all commands would be
/// pinned to the first cores.
Words environment_of(int jobs) {
  Words words = environment_of_no_rank();
  if (jobs == 1) return words;
  words.push_back("POCL_AFFINITY=0");
  const unsigned threads = std::max(1U, std::thread::hardware_concurrency() / static_cast<unsigned>(jobs));
  if (!std::getenv("POCL_MAX_PTHREAD_COUNT")) words.push_back(text("POCL_MAX_PTHREAD_COUNT=", threads));
  return words;
}

/// What --max-memory says to each of N commands: the user's word, or 1/N of what is free now; nothing for one alone.
std::string memory_of(int jobs, const Common& common) {
  if (jobs == 1 || !common.max_memory.empty()) return common.max_memory;
  open_device(common);
  return std::to_string(memory_budget() / static_cast<uint64_t>(jobs));
}

class TableRun {
 public:
  TableRun(const TableFolder& folder, const TablePlan& plan, int jobs, const Common& common)
      : folder_(folder),
        plan_(plan),
        jobs_(std::min(jobs, static_cast<int>(plan.nodes.size()))),
        common_(common),
        memory_(memory_of(jobs_, common)),
        line_(common),
        busy_(static_cast<std::size_t>(ranks().size())) {}

  int run();

 private:
  enum class State { waiting, running, done, failed, left_out };

  void run_commands();
  std::string own_news();
  Report decide(const std::vector<std::string>& news);
  void heed(const Report& news);
  void wait_for_news();
  const TableNode* ready_node();
  bool is_taken(const TableNode& node) const;
  void look_at(const TableNode& node);
  void announce(const TableNode& node);
  const TableNode& node_named(const std::string& id) const;
  Report run_command(const TableNode& node);
  Report news_of(const TableNode& node);
  Words words_of(const TableNode& node, bool resumes) const;
  ChildEnd run_child_of(const TableNode& node, const Words& words, std::string& said_error);
  void show(const TableNode& node, const std::string& said);
  void keep_figures(const TableNode& node) const;
  Report failed(const TableNode& node, NodeRecord record, int code, const std::string& error) const;
  void sort_troubles();
  void write_results();
  nlohmann::ordered_json told() const;
  std::size_t done() const;

  const TableFolder& folder_;
  const TablePlan& plan_;
  const int jobs_;  // commands side by side, of a rank
  const Common& common_;
  const std::string memory_;  // of a command; empty: its default
  std::mutex mutex_;          // of the four below, while commands run
  std::condition_variable ended_;
  Report news_ = Report::array();                 // of commands that ended since the first rank was told
  std::map<std::string, std::string> last_said_;  // of the commands that run
  RewrittenLine line_;
  // What the first rank alone knows:
  std::map<std::string, State> states_;
  std::vector<int> busy_;  // how many commands a rank runs
  std::vector<TableTrouble> failed_, left_out_;
  std::map<std::string, Fault> faults_;  // of those that failed
  std::optional<Error> broken_;          // no fault of a command's: the folder cannot be written, say
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
  if (!memory_.empty()) words.insert(words.end(), {"--max-memory", memory_});
  return words;
}

/// One line for all commands that run.
void TableRun::show(const TableNode& node, const std::string& said) {
  const std::lock_guard lock(mutex_);
  if (common_.verbose) return say(common_, jobs_ > 1 ? node.id + "  " + said : said);
  last_said_[node.id] = said;
  if (!line_.on_terminal()) return;
  const std::string between = " | ";
  const std::size_t width = (kLineWidth + between.size()) / last_said_.size() - between.size();
  std::string line;
  for (const auto& [id, words] : last_said_)
    line += (line.empty() ? "" : between) + (id + "  " + words).substr(0, width);
  line_.draw(line);
}

ChildEnd TableRun::run_child_of(const TableNode& node, const Words& words, std::string& said_error) {
  const ChildEnd end = run_child({kOurselves, words, environment_of(jobs_)}, [&](const std::string& said) {
    if (said.starts_with("error: ")) said_error = said;
    show(node, said);
  });
  const std::lock_guard lock(mutex_);
  last_said_.erase(node.id);
  line_.end();
  return end;
}

/// An evaluation writes into the run, where that of the next protocol takes its place.
void TableRun::keep_figures(const TableNode& node) const {
  if (node.work != TableWork::measure) return;
  const fs::path run = folder_.word(node.words.at(1));
  const auto bytes = read_file(RunPaths{run}.eval() / "eval.json", kLargestFigures);
  commit_text(folder_.figures(node), std::string(bytes.begin(), bytes.end()));
}

Report TableRun::failed(const TableNode& node, NodeRecord record, int code, const std::string& error) const {
  record.state = "failed";
  record.error = error;
  write_node(folder_, node, record);
  return {{"id", node.id}, {"end", "failed"}, {"code", code}, {"error", error}};
}

/// How it ended: done, failed, or stopped because it was asked to, which is neither.
Report TableRun::run_command(const TableNode& node) {
  NodeRecord record{"running", node.words, {}, {}};
  const bool begun = read_node(folder_, node).has_value();
  if (begun && is_training(node)) wait_until_free(folder_.of(node));
  const bool resumes =
      begun && is_training(node) && fs::exists(RunPaths{folder_.of(node)}.checkpoints() / "latest.txt");
  if (!resumes) remove_folder(folder_.of(node));
  write_node(folder_, node, record);
  const Clock::time_point start = Clock::now();
  std::string said_error;
  const ChildEnd end = run_child_of(node, words_of(node, resumes), said_error);
  if (end.code != 0 && stop_signal.load() != 0) return {{"id", node.id}, {"end", "stopped"}};
  if (end.code != 0) return failed(node, record, end.code, said_error.empty() ? end.in_words() : said_error);
  keep_figures(node);
  record.state = "done";
  // As if it had all cores and ranks: commands side by side share them.
  const double side_by_side = static_cast<double>(jobs_ * ranks().size());
  if (!resumes) record.seconds = std::chrono::duration<double>(Clock::now() - start).count() / side_by_side;
  write_node(folder_, node, record);
  if (is_done(folder_, node)) return {{"id", node.id}, {"end", "done"}};
  return failed(node, record, 1, "the command ended well, but what it was to make is not there");
}

/// Runs it; what is no fault of the command's ends the table.
Report TableRun::news_of(const TableNode& node) {
  try {
    return run_command(node);
  } catch (...) {
    const Error error = current_error();
    int none = 0;  // the other commands are ended, too
    stop_signal.compare_exchange_strong(none, SIGTERM);
    return {{"id", node.id}, {"end", "broken"}, {"code", static_cast<int>(error.fault())}, {"error", error.what()}};
  }
}

/// Done before, or left out because what it needs is not there; else it goes on waiting.
void TableRun::look_at(const TableNode& node) {
  State& state = states_.at(node.id);
  for (const std::string& need : node.needs) {
    const State of_need = states_.at(need);
    if (of_need == State::done) continue;
    if (of_need == State::waiting || of_need == State::running) return;
    left_out_.push_back({node.id, "needs " + need});
    state = State::left_out;
    return;
  }
  if (is_done(folder_, node)) state = State::done;
}

bool TableRun::is_taken(const TableNode& node) const {
  return std::any_of(plan_.nodes.begin(), plan_.nodes.end(), [&](const TableNode& other) {
    return states_.at(other.id) == State::running && take_turns(node, other);
  });
}

/// The first in the list whose needs are there. Null if there is none now.
const TableNode* TableRun::ready_node() {
  for (const TableNode& node : plan_.nodes) {
    if (states_.at(node.id) != State::waiting) continue;
    look_at(node);
    const bool ready = std::all_of(node.needs.begin(), node.needs.end(),
                                   [&](const std::string& need) { return states_.at(need) == State::done; });
    if (ready && states_.at(node.id) == State::waiting && !is_taken(node)) return &node;
  }
  return nullptr;
}

void TableRun::announce(const TableNode& node) {
  const auto number = static_cast<std::size_t>(&node - plan_.nodes.data()) + 1;
  const std::lock_guard lock(mutex_);
  line_.end();
  say(common_, text("[", number, "/", plan_.nodes.size(), "] ", node.id, "; ",
                    words_for_seconds(seconds_left(folder_, plan_)), " left in total"));
}

const TableNode& TableRun::node_named(const std::string& id) const {
  return *std::find_if(plan_.nodes.begin(), plan_.nodes.end(), [&](const TableNode& node) { return node.id == id; });
}

std::string TableRun::own_news() {
  const std::lock_guard lock(mutex_);
  const Report news = {{"signal", stop_signal.load()}, {"ended", std::exchange(news_, Report::array())}};
  return news.dump(-1, ' ', false, Report::error_handler_t::replace);
}

/// A command that ended.
void TableRun::heed(const Report& news) {
  const auto id = news.at("id").get<std::string>(), end = news.at("end").get<std::string>();
  states_.at(id) = end == "done" ? State::done : State::failed;
  if (end == "done" || end == "stopped") return;
  const auto error = news.at("error").get<std::string>();
  const Fault fault = fault_of(news.at("code").get<int>());
  if (end == "broken") {
    if (!broken_) broken_.emplace(fault, error);
    return;
  }
  faults_[id] = fault;
  failed_.push_back({id, error});
  const std::lock_guard lock(mutex_);
  line_.end();
  warn(id + " failed: " + error);
}

/// By the news of all ranks: which commands begin, and on which rank; the signal to stop by, if any; whether all is
/// over.
Report TableRun::decide(const std::vector<std::string>& news) {
  int signal = 0;
  for (std::size_t rank = 0; rank < news.size(); ++rank) {
    const Report of_rank = Report::parse(news[rank]);
    if (signal == 0) signal = of_rank.at("signal").get<int>();
    busy_[rank] -= static_cast<int>(of_rank.at("ended").size());
    for (const Report& ended : of_rank.at("ended")) heed(ended);
  }
  Report begin = Report::array();
  while (signal == 0) {
    const auto idle = std::min_element(busy_.begin(), busy_.end());
    const TableNode* node = *idle < jobs_ ? ready_node() : nullptr;
    if (!node) break;
    states_.at(node->id) = State::running;
    ++*idle;
    announce(*node);
    begin.push_back({{"id", node->id}, {"rank", idle - busy_.begin()}});
  }
  const bool over = std::all_of(busy_.begin(), busy_.end(), [](int count) { return count == 0; });
  return {{"begin", begin}, {"signal", signal}, {"over", over}};
}

/// Other ranks have news now and then.
void TableRun::wait_for_news() {
  std::unique_lock lock(mutex_);
  const auto any = [&] { return !news_.empty(); };
  if (ranks().size() == 1) return ended_.wait(lock, any);
  ended_.wait_for(lock, kLook, any);
}

/// The first rank decides which of them runs a command.
void TableRun::run_commands() {
  std::vector<std::jthread> commands;
  try {
    for (;;) {
      const std::vector<std::string> news = gathered(ranks(), own_news());
      const Report orders = Report::parse(gathered(ranks(), ranks().rank() == 0 ? decide(news).dump() : "").front());
      int none = 0;
      stop_signal.compare_exchange_strong(none, orders.at("signal").get<int>());
      for (const Report& order : orders.at("begin")) {
        if (order.at("rank") != ranks().rank()) continue;
        commands.emplace_back([this, &node = node_named(order.at("id").get<std::string>())] {
          const Report ended = news_of(node);
          const std::lock_guard lock(mutex_);
          news_.push_back(ended);
          ended_.notify_all();
        });
      }
      if (orders.at("over").get<bool>()) return;
      wait_for_news();
    }
  } catch (...) {
    int none = 0;  // the commands are ended first
    stop_signal.compare_exchange_strong(none, SIGTERM);
    throw;
  }
}

/// Whatever came first in time: equal calls tell the same.
void TableRun::sort_troubles() {
  std::map<std::string, std::size_t> place;
  for (std::size_t i = 0; i < plan_.nodes.size(); ++i) place[plan_.nodes[i].id] = i;
  for (std::vector<TableTrouble>* troubles : {&failed_, &left_out_})
    std::sort(troubles->begin(), troubles->end(),
              [&](const TableTrouble& a, const TableTrouble& b) { return place.at(a.id) < place.at(b.id); });
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
  const bool first = ranks().rank() == 0;
  std::optional<FolderLock> lock;
  if (first) lock.emplace(folder_.root);
  if (first) fs::create_directories(folder_.root / "nodes");  // from here on the folder is known as a table's
  const StopOnSignal signals("ending what runs; trainings save their step");
  for (const TableNode& node : plan_.nodes) states_[node.id] = State::waiting;
  run_commands();
  if (!first) return 0;
  sort_troubles();
  if (broken_) throw *broken_;
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
  throw Error(faults_.at(failed_.front().id),
              text(failed_.size(), " of ", plan_.nodes.size(), " commands failed, and ", left_out_.size(),
                   " that need them were left out; the same command tries them again", lines));
}

}  // namespace

int run_tables(const TableFolder& folder, const TablePlan& plan, int jobs, const Common& common) {
  return TableRun(folder, plan, jobs, common).run();
}

}  // namespace cloam
