// See view_edits.h.
#include "cli/view_edits.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <cmath>
#include <nlohmann/json.hpp>

#include "cli/commands.h"
#include "cli/view_jobs.h"
#include "models/io/words.h"
#include "models/runs/actor_names.h"
#include "models/runs/edit_run.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMostUndone = 200;
constexpr double kFarthest = 1e4;  // metres
constexpr double kFinest = 1e4;    // parts of a metre, or a degree, that words tell
const char* const kWhere = "the request";
const std::vector<std::string> kOperations = {"hide", "show", "move", "turn", "exchange", "generate"};

/// As short as it can be written: words are to be read.
std::string number_word(double value) { return fmt::format("{}", std::round(value * kFinest) / kFinest + 0.0); }

Eigen::Vector3d shift_in(const Json& request) {
  const Json& numbers = array(request, "shift", kWhere);
  Eigen::Vector3d shift = Eigen::Vector3d::Zero();
  const bool sound = numbers.size() == 3 && std::all_of(numbers.begin(), numbers.end(), [](const Json& number) {
                       return number.is_number() && std::abs(number.get<double>()) < kFarthest;
                     });
  if (!sound) bad_data(kWhere, ": \"shift\" is ", numbers.dump().substr(0, 80), ", want three numbers of metres");
  for (std::size_t i = 0; i < 3; ++i) shift[static_cast<int>(i)] = numbers[i].get<double>();
  return shift;
}

/// Where the actor's axes point at the time of the request; without one, or where it is nowhere then, at first.
Eigen::Matrix3d axes_of(const Actor& actor, const Json& request) {
  const std::optional<double> time = optional_number(request, "time", kWhere);
  const auto pose = time ? world_from_box_at(actor, *time) : std::nullopt;
  if (pose) return pose->topLeftCorner<3, 3>();
  return actor.boxes.empty() ? Eigen::Matrix3d::Identity()
                             : Eigen::Matrix3d(actor.boxes.front().world_from_box.topLeftCorner<3, 3>());
}

bool is_free(const fs::path& folder) {
  std::error_code error;
  return !fs::exists(folder, error) || (fs::is_directory(folder, error) && fs::is_empty(folder, error));
}

}  // namespace

ViewEdits::ViewEdits(StoredRun& run, std::string prior, std::function<fs::path()> find_prior)
    : run_(run), prior_(std::move(prior)), edits_(run, std::move(find_prior)), logs_(log_names(run.record)) {}

ViewEdits::State ViewEdits::state() const {
  State state = now_;
  for (const Scene& scene : run_.scenes) state.actors.push_back(scene.actors);
  state.generated = run_.generated;
  return state;
}

void ViewEdits::restore(const State& state) {
  for (std::size_t i = 0; i < run_.scenes.size(); ++i) run_.scenes[i].actors = state.actors.at(i);
  run_.generated = state.generated;
  now_ = {{}, {}, state.words, state.hidden};
}

void ViewEdits::undo() {
  if (history_.empty()) throw Refused(409, "there is nothing to undo");
  restore(history_.back());
  history_.pop_back();
}

/// What follows the actor's name in the words of `edit`.
std::string ViewEdits::operation(const Json& request, const AssetName& name) const {
  const std::string what = string(request, "op", kWhere);
  if (what == "hide" || what == "show") return "remove";
  if (what == "move") {
    const Eigen::Vector3d shift = axes_of(actor_of(run_.scenes, name), request).transpose() * shift_in(request);
    return text("shift=", number_word(shift.x()), ",", number_word(shift.y()), ",", number_word(shift.z()));
  }
  if (what == "turn") {
    const double degrees = number(request, "degrees", kWhere);
    if (std::abs(degrees) > 360) bad_data(kWhere, ": \"degrees\" is ", degrees, ", want -360 to 360");
    return "rotate=" + number_word(degrees);
  }
  if (what == "exchange")
    return "replace=" + spelled(run_.scenes, find_actor(run_.scenes, logs_, string(request, "asset", kWhere)));
  if (what == "generate") {
    const double seed = optional_number(request, "seed", kWhere).value_or(0);
    if (seed < 0 || seed > 9e15 || seed != std::floor(seed))
      bad_data(kWhere, ": \"seed\" is ", seed, ", want a whole number from 0");
    return text("replace=", kGenerated, ":", static_cast<uint64_t>(seed));
  }
  bad_data(kWhere, ": \"op\" is \"", what.substr(0, 40), "\"", did_you_mean(what, kOperations), "; want ",
           joined(kOperations));
}

/// As if it had never been hidden: nothing was done to it since.
void ViewEdits::show(const AssetName& actor, const std::string& word) {
  const auto found = now_.hidden.find(key_of(actor));
  if (found == now_.hidden.end()) throw Refused(409, text(actor.actor_id, " is not hidden"));
  actor_of(run_.scenes, actor).boxes = found->second;
  now_.hidden.erase(found);
  const auto last = std::find(now_.words.rbegin(), now_.words.rend(), word);
  now_.words.erase(std::next(last).base());
}

void ViewEdits::apply(const Json& request) {
  const AssetName actor = find_actor(run_.scenes, logs_, string(request, "id", kWhere));
  const std::string what = string(request, "op", kWhere);
  const std::string word = spelled(run_.scenes, actor) + ":" + operation(request, actor);
  if (what != "show" && hides(actor)) throw Refused(409, text(actor.actor_id, " is hidden: show it first"));
  State before = state();
  try {
    if (what == "show") {
      show(actor, word);
    } else {
      if (what == "hide") now_.hidden[key_of(actor)] = actor_of(run_.scenes, actor).boxes;
      edits_.apply_all(word, {});
      now_.words.push_back(word);
    }
  } catch (...) {
    restore(before);
    throw;
  }
  history_.push_back(std::move(before));
  if (history_.size() > kMostUndone) history_.erase(history_.begin());
}

Actor ViewEdits::shown(const AssetName& name) const {
  Actor actor = actor_of(run_.scenes, name);
  if (const auto found = now_.hidden.find(key_of(name)); found != now_.hidden.end()) actor.boxes = found->second;
  return actor;
}

std::vector<std::string> ViewEdits::command(const std::string& folder) const {
  std::vector<std::string> words = {"edit", run_.folder.string()};
  bool generates = false;
  for (const std::string& word : now_.words) {
    words.insert(words.end(), {"--actor", word});
    generates = generates || word.find(text("replace=", kGenerated)) != std::string::npos;
  }
  if (generates && !prior_.empty()) words.insert(words.end(), {"--prior", prior_});
  words.insert(words.end(), {"-o", folder});
  return words;
}

void ViewEdits::save(const std::string& folder) {
  if (const std::string problem = folder.empty() ? "want the name of a folder" : problem_of(output_folder(), folder);
      !problem.empty())
    throw Refused(400, "cannot save: " + problem);
  if (!can_save()) throw Refused(409, "cannot save: nothing was changed");
  std::error_code error;
  const fs::path place = fs::weakly_canonical(folder, error);
  if (saved_.contains(place) && is_run(place) && read_record(place).edited_from) clear_run(place);
  if (!is_free(place))
    throw Refused(409, text("cannot save: ", folder, " exists, and this viewer did not write it; give another name"));
  write_edited_run(run_, folder, typed(command(folder)));
  saved_.insert(fs::weakly_canonical(folder, error));
}

}  // namespace cloam
