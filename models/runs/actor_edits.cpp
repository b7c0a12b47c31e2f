// See actor_edits.h.
#include "models/runs/actor_edits.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "models/data/path_file.h"
#include "models/gaussians/adopts_actors.h"
#include "models/io/words.h"
#include "models/latents/shows_assets.h"
#include "models/runs/actor_names.h"
#include "models/runs/adopted_actor.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr double kLargestMove = 1e5;  // metres or degrees: beyond it, logs are refused and angles lose their digits

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

/// The seed in "generated:7"; none in "generated".
std::optional<uint64_t> seed_in(const std::string& operand, const std::string& given) {
  const std::size_t colon = operand.find(':');
  if (colon == std::string::npos) return std::nullopt;
  const auto seed = number_in<uint64_t>(operand.substr(colon + 1));
  if (!seed) bad_operation(given, operand.substr(colon + 1) + " is not a seed: want a whole number from 0");
  return seed;
}

}  // namespace

ActorEdits::ActorEdits(StoredRun& run, std::function<std::filesystem::path()> prior, std::function<void()> open)
    : run_(run), prior_(std::move(prior)), open_(std::move(open)), before_(run.scenes), logs_(log_names(run.record)) {}

void ActorEdits::apply_all(const std::string& given, const MakerRequest& wish) {
  // An operand may have colons of its own (a log, a path): the last one before it ends the actor's name.
  const std::size_t colon = given.rfind(':', given.find_first_of("=,"));
  if (colon == std::string::npos || colon == 0) bad_operation(given, "want [LOG:]ID:OPERATION");
  const AssetName actor = find_actor(run_.scenes, logs_, given.substr(0, colon));
  for (const std::string& operation : split_operations(given.substr(colon + 1)))
    apply(parse(operation, actor, given, wish), run_.scenes, actor);
}

ActorEdit ActorEdits::parse(const std::string& operation, const AssetName& actor, const std::string& given,
                            const MakerRequest& wish) {
  const std::size_t equals = operation.find('=');
  const std::string name = operation.substr(0, equals);
  const std::string operand = equals == std::string::npos ? "" : operation.substr(equals + 1);
  const std::vector<std::string> known = {"shift", "rotate", "remove", "replace", "path"};
  if (std::find(known.begin(), known.end(), name) == known.end())
    bad_operation(given, text("there is no operation '", name, "'; want shift, rotate, remove, replace or path",
                              did_you_mean(name, known)));
  if (name == "remove" ? equals != std::string::npos : operand.empty()) {
    bad_operation(given, name + (name == "remove" ? " takes no operand" : " needs an operand after ="));
  }
  if (name == "remove") return Remove{};
  if (name == "replace" && operand.substr(0, operand.find(':')) == kGenerated)
    return generated(actor, {seed_in(operand, given).value_or(wish.seed), wish.guidance});
  if (name == "replace")
    if (const std::filesystem::path folder = run_named_in(operand); !folder.empty()) return adopted(operand, folder);
  if (name == "replace") return replace_by(before_, find_actor(before_, logs_, operand));
  if (name == "path") return Follow{read_path_file(operand)};
  const std::vector<double> v = numbers_of(operand, name == "shift" ? 3 : 1, given);
  if (std::any_of(v.begin(), v.end(), [](double number) { return std::abs(number) > kLargestMove; }))
    bad_operation(given, text(operand, " is more than ", kLargestMove, name == "shift" ? " metres" : " degrees"));
  if (name == "shift") return Shift{{v[0], v[1], v[2]}};
  return Turn{v[0] * std::numbers::pi / 180};
}

Replace ActorEdits::generated(const AssetName& actor, const MakerRequest& wish) {
  if (!has<ShowsAssets>(run_.record.method))
    throw Error(
        Fault::usage,
        text("replace=", kGenerated, " is for runs of genassets, whose actors are codes; ", run_.folder.string(),
             " is a run of ", run_.record.method, "\n  fix: replace=ID gives the looks of another of its actors",
             has<AdoptsActors>(run_.record.method) ? ", replace=RUN:ID those of another run's" : ""));
  if (!maker_) maker_.emplace(prior_(), run_);
  return maker_->make(run_, actor, wish);
}

Replace ActorEdits::adopted(const std::string& operand, const std::filesystem::path& folder) {
  const auto known = adopted_.find(operand);
  if (known != adopted_.end()) return known->second;
  if (!open_)
    throw Error(Fault::usage, text("replace=", operand, ": actors of other runs come by cloam edit ",
                                   quoted(run_.folder.string()), " --actor ID:replace=", quoted(operand), " -o RUN2"));
  open_();
  const StoredRun other = read_run(folder);
  const AssetName name = find_actor(other.scenes, log_names(other.record), operand.substr(folder.string().size() + 1));
  return adopted_[operand] = adopt_actor(run_, other, name);
}

}  // namespace cloam
