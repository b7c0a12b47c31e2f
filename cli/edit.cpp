// cloam edit: the actors of a trained street, listed with thumbnails, moved, turned, removed, swapped.
#include "models/scene/edit.h"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "cli/commands.h"
#include "cli/shipped.h"
#include "cli/terminal_picture.h"
#include "models/data/path_file.h"
#include "models/eval/actor_list.h"
#include "models/io/words.h"
#include "models/runs/actor_names.h"
#include "models/runs/asset_maker.h"
#include "models/runs/edit_run.h"
#include "runtime/error.h"

namespace cloam {
namespace {

using Report = nlohmann::ordered_json;

constexpr char kGenerated[] = "generated";
constexpr char kExamples[] = R"(List the actors of a trained street, or move, turn, remove or replace them in a new run.

Examples:
  cloam edit runs/street --list                                    the actors; thumbnails in runs/street/edit
  cloam edit runs/street --actor 3f2a:shift=2,0,0 -o runs/edited   2 m to its right
  cloam edit runs/street --actor 3f2a:rotate=90,shift=0,-5,0 --actor 1:77:remove -o runs/edited
  cloam edit runs/street --actor 3f2a:replace=0:c4 -o runs/edited  with the appearance of another, of any log
  cloam edit runs/street --actor 3f2a:path=drive.csv -o runs/edited
  cloam edit runs/street --actor 3f2a:replace=generated --prior runs/assets --seed 7 -o runs/edited
  cloam render runs/edited -o pictures                             see the result

--actor [LOG:]ID:OPERATION,... applies from left to right, and may be repeated:
  shift=X,Y,Z     metres along the actor's own axes: right, forward, up (or shift=X/Y/Z)
  rotate=DEGREES  around its own z axis, counter-clockwise seen from above
  remove          remove it, and its LiDAR points
  replace=OTHER   give it the appearance and size of another actor ([LOG:]ID), on the same ground
  replace=generated
                  replace it with a new asset of its class, for the log's time of day, from the diffusion run
                  --prior: of eight samples, the one with the most similar box
  path=FILE       move it along a CSV or JSON file of time, x, y, z, yaw in the log's world
                  (docs/formats.md); its name may not contain a comma
ID is any unique part of an actor's id; LOG is the number or name of its log, if there are several.)";

struct EditRequest {
  std::string run, out, prior, show;
  MakerRequest wish;
  std::vector<std::string> actors;
  bool list = false;
};

[[noreturn]] void bad_operation(const std::string& given, const std::string& why) {
  throw Error(Fault::usage, text("--actor ", given, ": ", why,
                                 "\n  example: --actor 3f2a:shift=2,0,0,rotate=90\n  see cloam edit --help"));
}

bool is_number_start(char c) { return std::isdigit(static_cast<unsigned char>(c)) || c == '-' || c == '+' || c == '.'; }

/// "shift=1,0,0,remove" -> "shift=1,0,0", "remove": a comma before a number continues the operation.
std::vector<std::string> split_operations(const std::string& list) {
  std::vector<std::string> operations;
  for (const std::string& piece : comma_separated(list)) {
    if (!operations.empty() && !piece.empty() && is_number_start(piece[0]))
      operations.back() += "," + piece;
    else
      operations.push_back(piece);
  }
  return operations;
}

std::vector<double> numbers_of(const std::string& list, std::size_t count, const std::string& given) {
  std::string spaced = list;
  std::replace(spaced.begin(), spaced.end(), '/', ',');
  std::vector<double> values;
  for (const std::string& word : comma_separated(spaced)) {
    std::size_t used = 0;
    try {
      values.push_back(std::stod(word, &used));
    } catch (const std::exception&) {}
    if (used == 0 || used != word.size() || !std::isfinite(values.back()))
      bad_operation(given, word + " is not a number");
  }
  if (values.size() != count) bad_operation(given, text("want ", count, " numbers, found ", values.size()));
  return values;
}

class Editor {
 public:
  Editor(const EditRequest& request, const Common& common)
      : request_(request),
        common_(common),
        run_(read_run(request.run)),
        before_(run_.scenes),
        logs_(log_names(run_.record)) {}

  /// "[LOG:]ID:OPERATION,..."
  void apply_all(const std::string& given) {
    // An operand may have colons of its own (a log, a path): the last one before it ends the actor's name.
    const std::size_t colon = given.rfind(':', given.find_first_of("=,"));
    if (colon == std::string::npos) bad_operation(given, "want [LOG:]ID:OPERATION");
    const AssetName actor = find_actor(run_.scenes, logs_, given.substr(0, colon));
    for (const std::string& operation : split_operations(given.substr(colon + 1))) {
      apply(parse(operation, actor, given), run_.scenes, actor);
    }
  }
  const StoredRun& run() const { return run_; }

 private:
  ActorEdit parse(const std::string& operation, const AssetName& actor, const std::string& given) {
    const std::size_t equals = operation.find('=');
    const std::string name = operation.substr(0, equals);
    const std::string operand = equals == std::string::npos ? "" : operation.substr(equals + 1);
    const std::vector<std::string> known = {"shift", "rotate", "remove", "replace", "path"};
    if (std::find(known.begin(), known.end(), name) == known.end())
      bad_operation(given, text("there is no operation '", name, "'; want shift, rotate, remove, replace or path",
                                did_you_mean(name, known)));
    if ((name == "remove") != (equals == std::string::npos)) {
      bad_operation(given, name + (name == "remove" ? " takes no operand" : " needs an operand after ="));
    }
    if (name == "remove") return Remove{};
    if (name == "replace" && operand == kGenerated) return generated(actor);
    if (name == "replace") return replace_by(before_, find_actor(before_, logs_, operand));
    if (name == "path") return Follow{read_path_file(operand)};
    const std::vector<double> v = numbers_of(operand, name == "shift" ? 3 : 1, given);
    if (name == "shift") return Shift{{v[0], v[1], v[2]}};
    return Turn{v[0] * std::numbers::pi / 180};
  }

  Replace generated(const AssetName& actor) {
    if (!maker_) {
      open_device(common_);
      maker_.emplace(prior_named(request_.prior.empty() ? kShipped : request_.prior), run_);
    }
    return maker_->make(run_, actor, request_.wish);
  }

  const EditRequest& request_;
  const Common& common_;
  StoredRun run_;
  const Scenes before_;  // what replace takes looks from, so that two actors can be swapped
  std::vector<std::string> logs_;
  std::optional<AssetMaker> maker_;
};

void put_table(const Report& report) {
  std::string out = fmt::format("{:>4}  {:<4} {:<38} {:<18} {:<18} {:>5} {:>6}\n", "no.", "log", "actor", "label",
                                "size w l h (m)", "boxes", "images");
  for (const Report& a : report["actors"]) {
    const Report& side = a["size_m"];
    const std::string size =
        fmt::format("{:.2f} {:.2f} {:.2f}", side[0].get<double>(), side[1].get<double>(), side[2].get<double>());
    const char* motion = a["boxes"] == 0 ? "removed" : a["stationary"].get<bool>() ? "stationary" : "moving";
    const std::string appearance = a["looks_of"].is_null() ? "" : ", appearance of " + a["looks_of"].get<std::string>();
    out += fmt::format("{:>4}  {:<4} {:<38.38} {:<18.18} {:<18} {:>5} {:>6}  {}{}\n", a["number"].get<int>(),
                       a["log"].get<int>(), a["actor"].get<std::string>(), a["label"].get<std::string>(), size,
                       a["boxes"].get<int>(), a["images"].get<int>(), motion, appearance);
  }
  put(out);
}

int list_actors(const EditRequest& request, const Common& common) {
  const RestoredRun run = restored(request.run, common);
  street_of(run);
  Report report = list_of_actors(run);
  if (report["actors"].empty()) throw Error(Fault::data, "the logs of the run " + request.run + " have no actors");
  const fs::path sheet =
      write_thumbnails(run, report, request.out.empty() ? RunPaths{request.run}.edit() : fs::path(request.out));
  warn_without_font();
  report["thumbnails"] = sheet.string();
  if (common.json)
    put_json(report);
  else
    put_table(report);
  say(common, text("thumbnails with their numbers are in ", sheet.string()));
  show_picture(request.show, sheet, common);
  return 0;
}

/// Before work begins.
void check_prior(const EditRequest& request) {
  const bool is_used = std::any_of(request.actors.begin(), request.actors.end(), [](const std::string& given) {
    return given.find(std::string("replace=") + kGenerated) != std::string::npos;
  });
  if (!is_used) throw Error(Fault::usage, "--prior is for --actor ID:replace=generated, which is not given");
  const std::string prior = prior_named(request.prior);
  check_is_prior(read_record(prior), prior);
}

int edit_actors(const EditRequest& request, const Common& common) {
  check_has_views(read_record(request.run));
  if (!request.prior.empty()) check_prior(request);
  Editor editor(request, common);
  for (const std::string& given : request.actors) editor.apply_all(given);
  write_edited_run(editor.run(), request.out, command_line());
  if (common.json) put_json({{"schema_version", 1}, {"run", request.out}});
  say(common, text("the edited run is ", request.out, "\n  cloam render ", quoted(request.out),
                   " -o pictures, cloam simulate ", quoted(request.out), " -o LOG"));
  return 0;
}

int run_command(const EditRequest& request, const Common& common) {
  if (request.list == !request.actors.empty()) {
    throw Error(Fault::usage, "want either --list, or --actor [LOG:]ID:OPERATION and -o RUN2; see cloam edit --help");
  }
  read_record(request.run);  // a wrong folder is told before a missing device
  if (request.list) return list_actors(request, common);
  if (request.out.empty()) throw Error(Fault::usage, "name the folder of the edited run with -o");
  return edit_actors(request, common);
}

}  // namespace

Command add_edit(CLI::App& program) {
  return command<EditRequest>(program, "edit", kExamples, run_command, [](const Options& add, EditRequest& r) {
    add("RUN", r.run, "Run folder").required();
    add("--list", r.list, "List the actors and draw a sheet of thumbnails");
    add_show(add, r.show);
    add("--actor", r.actors, "Edit of one actor, [LOG:]ID:OPERATION,... (may be repeated)").one_word();
    add("--prior", r.prior, "Diffusion run, for replace=generated (shipped)");
    add("--seed", r.wish.seed, "Random seed, for replace=generated (0)", whole_number(0));
    add("--guidance", r.wish.guidance, "Classifier-free guidance; above 1 follows class and time more closely (1)",
        number_from(0, 100));
    add("-o,--out", r.out, "Folder of the edited run; with --list, of the thumbnails (RUN/edit)");
  });
}

}  // namespace cloam
