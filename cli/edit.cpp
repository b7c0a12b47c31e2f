// cloam edit: the actors of a trained street, listed with thumbnails, moved, turned, removed, swapped.
#include "models/scene/edit.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "cli/commands.h"
#include "cli/shipped.h"
#include "cli/terminal_picture.h"
#include "models/eval/actor_list.h"
#include "models/io/words.h"
#include "models/runs/actor_edits.h"
#include "models/runs/actor_names.h"
#include "models/runs/edit_run.h"
#include "runtime/error.h"

namespace cloam {
namespace {

using Report = nlohmann::ordered_json;

constexpr char kEditExamples[] =
    R"(List the actors of a trained street, or move, turn, remove or replace them in a new run.

Examples:
  cloam edit runs/street --list                                    the actors; thumbnails in runs/street/edit
  cloam edit runs/street --actor 3f2a:shift=2,0,0 -o runs/edited   2 m to its right
  cloam edit runs/street --actor 3f2a:rotate=90,shift=0,-5,0 --actor 1:77:remove -o runs/edited
  cloam edit runs/street --actor 3f2a:replace=0:c4 -o runs/edited  with the appearance of another, of any log
  cloam edit runs/street --actor 3f2a:replace=runs/other:c4 -o runs/edited     of another run of street-gaussians
  cloam edit runs/street --actor 3f2a:path=drive.csv -o runs/edited
  cloam edit runs/street --actor 3f2a:replace=generated --prior runs/assets --seed 7 -o runs/edited
  cloam render runs/edited -o pictures                             see the result

--actor [LOG:]ID:OPERATION,... applies from left to right, and may be repeated:
  shift=X,Y,Z     metres along the actor's own axes: right, forward, up (or shift=X/Y/Z)
  rotate=DEGREES  around its own z axis, counter-clockwise seen from above
  remove          remove it, and its LiDAR points
  replace=OTHER   give it the appearance and size of another actor ([LOG:]ID), on the same ground; RUN:[LOG:]ID is
                  one of another run, where both are runs of street-gaussians
  replace=generated
                  replace it with a new asset of its class, for the log's time of day, from the diffusion run
                  --prior: of eight samples, the one with the most similar box; generated:7 has the
                  seed 7 instead of --seed
  path=FILE       move it along a CSV or JSON file of time, x, y, z, yaw in the log's world
                  (docs/formats.md); its name may not contain a comma
ID is any unique part of an actor's id; LOG is the number or name of its log, if there are several.)";

struct EditRequest {
  std::string run, out, prior, show;
  MakerRequest wish;
  std::vector<std::string> actors;
  bool list = false;
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
  StoredRun run = read_run(request.run);
  const auto open = [&] { open_device(common); };
  ActorEdits edits(
      run,
      [&] {
        open();
        return prior_named(request.prior.empty() ? kShipped : request.prior);
      },
      open);
  for (const std::string& given : request.actors) edits.apply_all(given, request.wish);
  write_edited_run(run, request.out, command_line());
  if (common.json) put_json({{"schema_version", 1}, {"run", request.out}});
  say(common, text("the edited run is ", request.out, "\n  cloam render ", quoted(request.out),
                   " -o pictures, cloam simulate ", quoted(request.out), " -o LOG"));
  return 0;
}

int run_edit(const EditRequest& request, const Common& common) {
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
  return command<EditRequest>(program, "edit", kEditExamples, run_edit, [](const Options& add, EditRequest& r) {
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
