// The paper's tables: the list of runs as data, which of them are done, and the figures that come of them.
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "models/eval/table_figures.h"
#include "models/eval/table_state.h"
#include "models/methods/registry.h"
#include "tests/models/errors.h"
#include "tests/models/folder.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

using Report = nlohmann::ordered_json;

/// 103 logs by the names of PandaSet's, the seven that the paper measures among them; images without content.
void write_pandaset_names(const fs::path& root, int frames, const std::vector<std::string>& cameras) {
  std::set<std::string> names(paper_logs().begin(), paper_logs().end());
  for (int log = 2; names.size() < 103; ++log) names.insert(std::to_string(1000 + log).substr(1));
  for (const std::string& name : names)
    for (const std::string& camera : cameras)
      for (int frame = 0; frame < frames; ++frame)
        write_text(root / name / "camera" / camera / (std::to_string(100 + frame).substr(1) + ".jpg"), "");
}

std::vector<TableRow> rows_of(const std::vector<std::string>& keys) {
  std::vector<TableRow> rows;
  for (const TableRow& row : genassets_rows())
    if (std::find(keys.begin(), keys.end(), row.key) != keys.end()) rows.push_back(row);
  return rows;
}

TableRequest paper_request(const fs::path& root) {
  TableRequest request;
  request.logs = find_table_logs({root.string(), "", ""});
  request.rows = rows_of({"full", "nokl", "noperceptual", "direct"});
  for (const char* method : {"nerf", "splat"}) request.rows.push_back(row_of_method(method));
  request.protocols = table_protocols();
  return request;
}

TableRequest small_request() {
  TableRequest request;
  request.small = true;
  request.rows = rows_of({"full", "nokl", "noperceptual", "direct", "direct-mirrored"});
  request.protocols = table_protocols();
  return request;
}

void check_sound(const TablePlan& plan) {
  std::set<std::string> known;
  for (const TableNode& node : plan.nodes) {
    for (const std::string& need : node.needs) CHECK_MESSAGE(known.contains(need), node.id << " needs " << need);
    CHECK_MESSAGE(known.insert(node.id).second, node.id << " is there twice");
    CHECK(node.steps > 0);
    CHECK(node.seconds > 0);
    // What a command reads of the table's folder is made by one that it needs.
    for (const std::string& word : node.words) {
      if (!word.starts_with("@/") || word.starts_with("@/" + node.id)) continue;
      const bool made = std::any_of(node.needs.begin(), node.needs.end(),
                                    [&](const std::string& need) { return word.starts_with("@/" + need); });
      CHECK_MESSAGE(made, node.id << " reads " << word);
    }
  }
}

const TableNode& node_of(const TablePlan& plan, const std::string& id) {
  const auto found =
      std::find_if(plan.nodes.begin(), plan.nodes.end(), [&](const TableNode& node) { return node.id == id; });
  REQUIRE_MESSAGE(found != plan.nodes.end(), id);
  return *found;
}

/// The word behind an option; "" without it.
std::string option_of(const TableNode& node, const std::string& option) {
  const auto found = std::find(node.words.begin(), node.words.end(), option);
  return found == node.words.end() ? "" : *(found + 1);
}

/// The values of --set as the last of each key stands.
std::map<std::string, std::string> settings_of(const TableNode& node) {
  std::map<std::string, std::string> settings;
  for (std::size_t i = 0; i + 1 < node.words.size(); ++i) {
    if (node.words[i] != "--set") continue;
    const std::size_t equals = node.words[i + 1].find('=');
    settings[node.words[i + 1].substr(0, equals)] = node.words[i + 1].substr(equals + 1);
  }
  return settings;
}

/// All settings that a training of stage 1 uses.
std::map<std::string, std::string> all_settings(const TableNode& node) {
  std::map<std::string, std::string> settings;
  for (const auto& [key, value] : find_preset(option_of(node, "--preset")).settings) settings[key] = value;
  for (const auto& [key, value] : settings_of(node)) settings[key] = value;
  return settings;
}

std::set<std::string> differing(const TableNode& a, const TableNode& b) {
  auto one = all_settings(a), other = all_settings(b);
  std::set<std::string> keys;
  for (const auto& [key, value] : one)
    if (!other.contains(key) || other[key] != value) keys.insert(key);
  for (const auto& [key, value] : other)
    if (!one.contains(key)) keys.insert(key);
  return keys;
}

/// One row, two logs, two seeds; sparse alone.
TablePlan little_plan(const std::vector<std::string>& rows = {"full"}) {
  TableRequest request;
  request.small = true;
  request.logs.train = {{"/logs/a", "a", 40, 20}};
  request.logs.measured = {{"/logs/b", "b", 40, 20}, {"/logs/c", "c", 40, 20}};
  request.rows = rows_of(rows);
  request.protocols = {"sparse"};
  request.seeds = {1, 2};
  return table_plan(request);
}

void write_done(const TableFolder& folder, const TableNode& node, double seconds) {
  write_node(folder, node, {"done", node.words, seconds, ""});
}

}  // namespace

TEST_CASE("table, the paper's: 96 logs train, 7 are measured, each row and method by each protocol it can") {
  const Folder folder;
  write_pandaset_names(folder.path, 8, {"front_camera", "front_left_camera", "back_camera"});
  const TablePlan plan = table_plan(paper_request(folder.path));
  check_sound(plan);
  CHECK(plan.request.logs.train.size() == 96);
  std::vector<std::string> measured;
  for (const TableLog& log : plan.request.logs.measured) measured.push_back(log.name);
  CHECK(measured == std::vector<std::string>{"001", "030", "040", "080", "090", "110", "120"});
  const TableNode& stage1 = node_of(plan, "train/full/1");
  const auto logs = std::count_if(stage1.words.begin(), stage1.words.end(),
                                  [&](const std::string& word) { return word.starts_with(folder.path.string()); });
  CHECK(logs == 96);
  for (const TableLog& log : plan.request.logs.measured)
    CHECK(std::find(stage1.words.begin(), stage1.words.end(), log.path) == stage1.words.end());
  CHECK(stage1.steps == int64_t{96} * 24 * 100);  // the preset's epochs
  CHECK(option_of(stage1, "--preset") == "genassets");
  CHECK(option_of(stage1, "--steps").empty());

  std::map<TableWork, int> count;
  std::map<std::string, int> by_protocol;
  for (const TableNode& node : plan.nodes) {
    ++count[node.work];
    if (node.work == TableWork::measure) ++by_protocol[node.protocol];
  }
  CHECK(count[TableWork::logs] == 0);
  CHECK(count[TableWork::crops] == 1);  // of the measured logs, one reference for all rows
  for (const char* row : {"full", "nokl"})
    CHECK(option_of(node_of(plan, text("measure/", row, "/1/generation")), "--photos") == "@/crops");
  CHECK(count[TableWork::train] == 4);
  CHECK(count[TableWork::fit] == 6 * 7 * 2);  // novel's run serves rotate360
  CHECK(count[TableWork::assets] == 2);       // Table A3
  CHECK(by_protocol ==
        std::map<std::string, int>{{"sparse", 6 * 7}, {"novel", 6 * 7}, {"rotate360", 4 * 7}, {"generation", 2}});
  CHECK(option_of(node_of(plan, "fit/full/1/030/novel"), "--networks") == "@/train/full/1");
  CHECK(node_of(plan, "measure/full/1/030/rotate360").words[1] == "@/fit/full/1/030/novel");
  CHECK(option_of(node_of(plan, "fit/nerf/1/030/sparse"), "--networks").empty());
  CHECK(table_methods() == std::vector<std::string>{"nerf", "splat", "street-gaussians", "neurad", "zipnerf"});
}

TEST_CASE("table, the small: its logs are made, its steps are said, and rows differ in what they are named after") {
  const TablePlan plan = table_plan(small_request());
  check_sound(plan);
  CHECK(plan.request.logs.train.size() == 16);
  CHECK(plan.request.logs.measured.size() == 2);
  CHECK(plan.request.logs.photographs.size() == 6);
  for (const TableLog& log : plan.request.logs.photographs) {
    const auto same = [&](const TableLog& other) { return other.path == log.path; };
    CHECK(std::none_of(plan.request.logs.train.begin(), plan.request.logs.train.end(), same));
  }
  for (const TableNode& node : plan.nodes) {
    for (const std::string& word : node.words) CHECK(word != "--time-budget");
    if (node.words[0] == "train") CHECK_MESSAGE(!option_of(node, "--steps").empty(), node.id);
  }
  const auto& logs = node_of(plan, "train/full/1").needs;
  CHECK(logs == std::vector<std::string>{"logs/sun", "logs/clouds"});
  const auto differs = [&](const char* row, const char* other) {
    return differing(node_of(plan, "train/" + std::string(row) + "/1"),
                     node_of(plan, "train/" + std::string(other) + "/1"));
  };
  CHECK(differs("full", "nokl") == std::set<std::string>{"weight.kl", "code.variational"});
  CHECK(differs("full", "noperceptual") == std::set<std::string>{"weight.perceptual"});
  CHECK(differs("full", "direct") == std::set<std::string>{"decoder.use", "actors.symmetric"});
  CHECK(differs("full", "direct-mirrored") == std::set<std::string>{"decoder.use"});
}

TEST_CASE("table: UniSim's row has its preset, and the other street methods stand beside it") {
  TableRequest request = small_request();
  request.rows = rows_of({"full", "unisim"});
  for (const char* method : {"street-gaussians", "neurad", "splat"}) request.rows.push_back(row_of_method(method));
  request.protocols = {"sparse", "novel"};
  const TablePlan plan = table_plan(request);
  CHECK(option_of(node_of(plan, "train/unisim/1"), "--preset") == "genassets-small-unisim");
  CHECK(find_preset("genassets-unisim").method == "genassets");
  for (const TableRow& row : request.rows)
    for (const std::string& protocol : request.protocols)
      CHECK_MESSAGE(std::any_of(plan.nodes.begin(), plan.nodes.end(),
                                [&](const TableNode& node) {
                                  return node.id.starts_with("measure/" + row.key + "/") && node.id.ends_with(protocol);
                                }),
                    row.key << " " << protocol);
}

TEST_CASE("table: methods alone need no stage 1, so no logs are made to train or to be photographed") {
  TableRequest request = small_request();
  request.rows = {row_of_method("splat"), row_of_method("neurad")};
  const TablePlan plan = table_plan(request);
  check_sound(plan);
  std::set<std::string> made;
  for (const TableNode& node : plan.nodes)
    if (node.work == TableWork::logs) made.insert(node.id);
  CHECK(made == std::set<std::string>{"logs/measured-clouds", "logs/measured-sun"});
  CHECK(plan.request.logs.train.empty());
  CHECK(node_of(plan, "measure/splat/1/measured-sun/sparse").needs.front() == "fit/splat/1/measured-sun/sparse");
}

TEST_CASE("table: the row of the networks that ship learns none, so no logs are made to train") {
  TableRequest request = small_request();
  request.rows = rows_of({"shipped"});
  const TablePlan plan = table_plan(request);
  check_sound(plan);
  CHECK(plan.request.logs.train.empty());
  for (const TableNode& node : plan.nodes) CHECK_FALSE(node.id.starts_with("train/"));
  const TableNode& fit = node_of(plan, "fit/shipped/1/measured-sun/sparse");
  CHECK(option_of(fit, "--networks") == "shipped");
  CHECK(fit.needs == std::vector<std::string>{"logs/measured-sun"});
  // Else as the row whose networks are learned.
  request.rows = rows_of({"full"});
  CHECK(option_of(fit, "--steps") ==
        option_of(node_of(table_plan(request), "fit/full/1/measured-sun/sparse"), "--steps"));
}

TEST_CASE("table, the small: measured logs that are named are measured, and made ones train") {
  const Folder folder;
  for (int frame = 0; frame < 8; ++frame) write_text(folder.path / text("a/camera/front_camera/0", frame, ".jpg"), "");
  TableRequest request = small_request();
  request.logs.measured = measured_table_logs({"", "", (folder.path / "a").string()});
  const TablePlan plan = table_plan(request);
  check_sound(plan);
  CHECK(plan.request.logs.train.size() == 16);
  CHECK(plan.request.logs.photographs.size() == 6);
  REQUIRE(plan.request.logs.measured.size() == 1);
  CHECK(node_of(plan, "fit/full/1/a/novel").words[2] == (folder.path / "a").string());
  for (const TableNode& node : plan.nodes) CHECK_FALSE(node.id.starts_with("logs/measured"));
  // The same trainings as of the table that makes its measured logs, too: they need not be done again.
  CHECK(node_of(plan, "train/full/1").words == node_of(table_plan(small_request()), "train/full/1").words);
  CHECK(measured_table_logs({}).empty());
}

TEST_CASE("table: evaluations of one run take turns, those of different runs need not") {
  const TablePlan plan = table_plan(small_request());
  const auto turns = [&](const char* one, const char* other) {
    const TableNode &a = node_of(plan, one), &b = node_of(plan, other);
    CHECK(take_turns(a, b) == take_turns(b, a));
    return take_turns(a, b);
  };
  CHECK(turns("measure/full/1/measured-sun/novel", "measure/full/1/measured-sun/rotate360"));
  CHECK_FALSE(turns("measure/full/1/measured-sun/novel", "measure/full/1/measured-sun/sparse"));
  CHECK_FALSE(turns("measure/full/1/measured-sun/novel", "measure/nokl/1/measured-sun/rotate360"));
  CHECK_FALSE(turns("fit/full/1/measured-sun/sparse", "fit/full/1/measured-sun/novel"));
  CHECK_FALSE(turns("train/full/1", "measure/full/1/generation"));
}

TEST_CASE("table: the rows' settings are those of the ablations' presets") {
  for (const auto& [key, preset] : std::map<std::string, std::string>{{"nokl", "genassets-small-nokl"},
                                                                      {"noperceptual", "genassets-small-noperceptual"},
                                                                      {"direct", "genassets-small-nodecoder"}}) {
    std::map<std::string, std::string> here, there;
    for (const auto& [name, value] : find_preset("genassets-small").settings) here[name] = value;
    const TableRow row = rows_of({key}).front();
    for (const std::string& setting : row.settings)
      here[setting.substr(0, setting.find('='))] = setting.substr(setting.find('=') + 1);
    for (const auto& [name, value] : find_preset(preset).settings) there[name] = value;
    CHECK_MESSAGE(here == there, key);
  }
}

TEST_CASE("table: logs by lists; what is missing, and what is in both lists, is told") {
  const Folder folder;
  for (const char* log : {"a", "b", "x/a"}) write_text(folder.path / log / "camera/front_camera/00.jpg", "");
  const std::string root = folder.path.string();
  const TableLogs logs = find_table_logs({"", root + "/b", root + "/a," + root + "/x/a"});
  CHECK(logs.train.front().name == "b");
  CHECK(logs.measured.size() == 2);
  CHECK(logs.measured[0].name != logs.measured[1].name);
  CHECK(holds(error_of([&] { find_table_logs({root, "", ""}); }, Fault::usage), "has no log 001"));
  CHECK(holds(error_of([&] { find_table_logs({root, "a", "a"}); }, Fault::usage), "in one list alone"));
  CHECK(holds(error_of([&] { find_table_logs({root, "nowhere", "a"}); }, Fault::usage), "there is no log nowhere"));
  CHECK(holds(error_of([] { find_table_logs({}); }, Fault::usage),
              "--size small without --train makes those that train"));
  CHECK(sparse_images(80) == 9);  // 0, 10, ..., 70 and 79
  CHECK(sparse_images(41) == 5);
  CHECK(sparse_images(6) == 2);
}

TEST_CASE("table: what is done is known by its record and by what it made; other words are another table") {
  const Folder root;
  const TableFolder folder{root.path / "table"};
  const TablePlan plan = little_plan();
  check_same_table(folder, plan);
  const TableNode& measured = node_of(plan, "measure/full/1/b/sparse");
  CHECK_FALSE(is_done(folder, measured));
  write_done(folder, measured, 5);
  CHECK_FALSE(is_done(folder, measured));  // no figures
  write_text(folder.figures(measured), "{\"psnr\": 2");
  CHECK_FALSE(is_done(folder, measured));  // not whole
  write_text(folder.figures(measured), "{\"psnr\": 2}");
  CHECK(is_done(folder, measured));
  write_node(folder, measured, {"running", measured.words, {}, ""});
  CHECK_FALSE(is_done(folder, measured));
  const TableNode& trained = node_of(plan, "train/full/1");
  write_done(folder, trained, 5);
  CHECK_FALSE(is_done(folder, trained));  // no run

  check_same_table(folder, plan);
  check_same_table(folder, little_plan({"full", "nokl"}));  // more rows
  TableRequest other = plan.request;
  other.steps = {{"train", 77}};
  const std::string told = error_of([&] { check_same_table(folder, table_plan(other)); }, Fault::usage);
  CHECK_MESSAGE(holds(told, "train/full/1 differs\n  before: ... --steps 2000 ...\n  now:    ... --steps 77"), told);
  write_text(root.path / "else" / "file", "");
  CHECK(holds(error_of([&] { check_same_table({root.path / "else"}, plan); }, Fault::usage), "holds no table"));
}

TEST_CASE("table: the time left follows what was timed, each kind of work by its own") {
  const Folder root;
  const TableFolder folder{root.path};
  const TablePlan plan = little_plan();
  double all = 0, fits = 0, rest = 0;
  for (const TableNode& node : plan.nodes) {
    all += node.seconds;
    const bool timed = node.id == "train/full/1" || node.id == "fit/full/1/b/sparse";
    if (!timed && node.work == TableWork::fit) fits += node.seconds;
    if (!timed && node.work != TableWork::fit) rest += node.seconds;
  }
  CHECK(seconds_left(folder, plan) == doctest::Approx(all));
  const TableNode &train = node_of(plan, "train/full/1"), &fit = node_of(plan, "fit/full/1/b/sparse");
  write_done(folder, train, train.seconds * 2);
  write_done(folder, fit, fit.seconds * 5);
  const double pictures_and_more = rest - node_of(plan, "train/full/2").seconds;
  const double mixed = (train.seconds * 2 + fit.seconds * 5) / (train.seconds + fit.seconds);
  const double left = fits * 5 + node_of(plan, "train/full/2").seconds * 2 + pictures_and_more * mixed;
  CHECK(seconds_left(folder, plan) == doctest::Approx(left));
}

TEST_CASE("table: means and spreads over seeds and logs, the best guess, and the paper's figure") {
  const TablePlan plan = little_plan({"full", "direct"});
  // Log b, log c; seed 1, seed 2.
  const std::map<std::string, double> psnr = {{"measure/full/1/b/sparse", 20.0},
                                              {"measure/full/1/c/sparse", 24.0},
                                              {"measure/full/2/b/sparse", 21.0},
                                              {"measure/full/2/c/sparse", 27.0},
                                              {"measure/direct/1/b/sparse", 17.0}};
  const TableFigures figures = table_figures(plan, [&](const TableNode& node) -> std::optional<Report> {
    if (!psnr.contains(node.id)) return {};
    const double guess = node.log == "b" ? 18 : 22;
    return Report{{"masked_psnr", psnr.at(node.id)},        {"baseline_blend_masked_psnr", guess},
                  {"baseline_copy_masked_psnr", guess - 1}, {"baseline_mean_masked_psnr", nullptr},
                  {"lidar_median_error_m", nullptr},        {"feature_network", "random features"}};
  });
  REQUIRE(figures.tables.size() == 1);
  const ProtocolTable& table = figures.tables.front();
  REQUIRE(table.columns.size() == 1);  // what is null everywhere has no column
  CHECK(std::string(table.columns.front().key) == "masked_psnr");
  REQUIRE(table.lines.size() == 2);
  const TableCell& full = *table.lines[0].cells[0];
  CHECK(full.mean == doctest::Approx(23.0));                           // of 22 and 24
  CHECK(*full.spread == doctest::Approx(std::sqrt(2.0)));              // of 22 and 24
  CHECK(*full.spread_of_logs == doctest::Approx(5 / std::sqrt(2.0)));  // of 20.5 and 25.5
  CHECK(full.seeds == std::vector<int64_t>{1, 2});
  CHECK(full.measured == 4);
  CHECK(*full.guess == doctest::Approx(20.0));
  CHECK(full.guess_key == "baseline_blend_masked_psnr");
  CHECK(*full.beats_guess);
  CHECK(*full.paper == doctest::Approx(21.34));
  const TableCell& direct = *table.lines[1].cells[0];
  CHECK(direct.mean == doctest::Approx(17.0));
  CHECK_FALSE(direct.spread);
  CHECK(direct.measured == 1);
  CHECK(direct.expected == 4);
  CHECK_FALSE(*direct.beats_guess);
  CHECK(figures.missing == std::vector<std::string>{"measure/direct/1/c/sparse", "measure/direct/2/b/sparse",
                                                    "measure/direct/2/c/sparse"});
  const std::string markdown = to_markdown(figures, plan);
  CHECK_MESSAGE(holds(markdown, "| full model | 23.00 +- 1.41 | 20.00 | 21.34 |\n"), markdown);
  CHECK_MESSAGE(holds(markdown, "| 17.00 (no better than the guess) (1 of 4 measured) | 18.00 | 19.31 |\n"), markdown);
  const Report json = to_json(figures, plan);
  CHECK(json["tables"][0]["rows"][0]["cells"][0]["mean"] == full.mean);
  CHECK(json["measured_logs"] == Report({"b", "c"}));
}

TEST_CASE("table: rows differ from the first by pairs of one log and one seed") {
  const TablePlan plan = little_plan({"full", "direct"});
  // The first row alone has log c with seed 2, where it is far ahead: that is no pair.
  const std::map<std::string, std::pair<double, double>> figures_of = {
      {"measure/full/1/b/sparse", {20.0, 0.30}},   {"measure/full/1/c/sparse", {24.0, 0.20}},
      {"measure/full/2/b/sparse", {21.0, 0.25}},   {"measure/full/2/c/sparse", {40.0, 0.01}},
      {"measure/direct/1/b/sparse", {19.0, 0.40}}, {"measure/direct/1/c/sparse", {21.0, 0.10}},
      {"measure/direct/2/b/sparse", {23.0, 0.35}}};
  const TableFigures figures = table_figures(plan, [&](const TableNode& node) -> std::optional<Report> {
    if (!figures_of.contains(node.id)) return {};
    const auto [psnr, distance] = figures_of.at(node.id);
    return Report{{"masked_psnr", psnr}, {"masked_feature_distance", distance}};
  });
  const ProtocolTable& table = figures.tables.front();
  REQUIRE(table.columns.size() == 2);
  for (const auto& cell : table.lines[0].cells) CHECK_FALSE(cell->from_first);
  const TableDifference psnr = *table.lines[1].cells[0]->from_first, distance = *table.lines[1].cells[1]->from_first;
  CHECK(psnr.mean == doctest::Approx(0.0));                    // seed 1: -1 and -3; seed 2: +2
  CHECK(*psnr.spread == doctest::Approx(4 / std::sqrt(2.0)));  // of -2 and 2
  CHECK(psnr.pairs == 3);
  CHECK(psnr.better == 1);
  CHECK(distance.mean == doctest::Approx(0.05));  // seed 1: +0.1 and -0.1; seed 2: +0.1
  CHECK(distance.better == 1);                    // less is better
  CHECK(
      holds(to_markdown(figures, plan), "| +0.00 +- 2.83 (better in 1 of 3) | +0.050 +- 0.071 (better in 1 of 3) |\n"));
  const Report json = to_json(figures, plan)["tables"][0]["rows"];
  CHECK(json[0]["cells"][0]["from_first"].is_null());
  CHECK(json[1]["cells"][1]["from_first"]["better"] == 1);
}

TEST_CASE("table: a figure within an object of eval.json has its guess there, too") {
  TableRequest request = little_plan().request;
  request.protocols = {"rotate360"};
  const TablePlan plan = table_plan(request);
  const TableFigures figures = table_figures(plan, [](const TableNode&) {
    return std::optional(
        Report{{"baseline_mean_masked_psnr", 30.0},
               {"without_0", {{"masked_psnr", 19.5}, {"baseline_mean_masked_psnr", 17.25}, {"images", 7}}}});
  });
  const ProtocolTable& table = figures.tables.front();
  REQUIRE(table.columns.size() == 1);
  CHECK(table.lines[0].cells[0]->mean == doctest::Approx(19.5));
  CHECK(*table.lines[0].cells[0]->guess == doctest::Approx(17.25));
}

TEST_CASE("table: where less is better, the least guess is the best one") {
  TableRequest request = little_plan().request;
  request.protocols = {kGeneration};
  request.seeds = {1};
  const TablePlan plan = table_plan(request);
  const TableFigures figures = table_figures(plan, [](const TableNode&) {
    return std::optional(Report{{"fid", 60.0}, {"baseline_random_fid", 200.0}, {"class_right_pictures", 0.9}});
  });
  const ProtocolTable& table = figures.tables.front();
  REQUIRE(table.columns.size() == 2);
  const TableCell& fid = *table.lines[0].cells[0];
  CHECK(*fid.beats_guess);
  CHECK(*fid.paper == doctest::Approx(59.5));
  CHECK_FALSE(table.lines[0].cells[1]->guess);
}
