// cloam train: options, the run folder's life, signals.
#include <fmt/format.h>
#include <malloc.h>

#include <algorithm>
#include <cstdlib>
#include <nlohmann/json.hpp>

#include "cli/commands.h"
#include "cli/failure.h"
#include "cli/ranks.h"
#include "cli/shipped.h"
#include "cli/stop_signal.h"
#include "cli/tensorboard.h"
#include "cli/train_pictures.h"
#include "cli/train_plan.h"
#include "cli/train_scale.h"
#include "cli/view_training.h"
#include "models/io/checkpoint.h"
#include "models/io/commit.h"
#include "models/methods/registry.h"
#include "models/runs/training.h"
#include "models/train/renders_views.h"
#include "runtime/error.h"
#include "runtime/watchdog.h"

namespace cloam {
namespace {

constexpr char kTrainExamples[] = R"(Train a scene from photos or driving logs.

Examples:
  cloam train nerf data/fox -o runs/fox --downscale 4 --holdout 8 --time-budget 5m
  cloam train diffusion runs/street -o runs/assets --preset diffusion-small
  cloam train genassets data/pandaset/009 --networks runs/street --prior runs/assets --image front_camera/05)";

/// As this rank of the program trains.
TrainOptions options_here(const TrainJob& job, const TrainRequest& request) {
  TrainOptions options = options_of(job, request);
  if (options.time_budget_seconds && request.pictures == "on")
    *options.time_budget_seconds -= kept_for_pictures(*options.time_budget_seconds);
  options.seconds_before = seconds_since_start();
  options.ranks = &ranks();
  return options;
}

void tell_end(const TrainJob& job, const TrainResult& result, const Common& common) {
  const std::string folder = quoted(job.folder.string());
  say(common, text("checkpoint ", result.checkpoint.string(), "  (step ", result.step, " of ", result.end, ", ",
                   words_for_seconds(seconds_since_start()), ")"));
  if (job.record.state == "finished") return say(common, "next: cloam eval " + folder);
  std::fprintf(stderr, "Continue: cloam train --resume %s\n", folder.c_str());
}

/// Ends the record of a training that failed; gives the error with what the run folder holds.
Error failed(TrainJob& job, const Error& first, int64_t saved, ProgressView& view, EventLog& log) {
  const Error error(first.fault(), first.what() + way_on(job, first.fault(), saved));
  view.finish();
  log.write("end", {{"state", "failed"}, {"exit", static_cast<int>(error.fault())}, {"message", error.what()}});
  try {
    end_failed_record(job);
  } catch (const Error&) {  // the disk may be the trouble; what is told is the first error
  }
  return error;
}

/// As long as it lives, told() sees the message of a device that hangs, and gives the one that is told.
class OnHang {
 public:
  explicit OnHang(const std::function<std::string(const std::string&)>& told) : before_(on_hang({})) {
    on_hang([tell = before_, told](const std::string& message) { tell(told(message)); });
  }
  ~OnHang() { on_hang(before_); }
  OnHang(const OnHang&) = delete;
  OnHang& operator=(const OnHang&) = delete;

 private:
  std::function<void(const std::string&)> before_;
};

/// Does the work of a training, which saves `saved` last. Whatever goes wrong is recorded, also a device that hangs.
template <class Work>
TrainResult recorded(TrainJob& job, const int64_t& saved, ProgressView& view, EventLog& log, const Work& work) {
  const OnHang hang([&](const std::string& message) {
    return std::string(failed(job, Error(Fault::device, message), saved, view, log).what());
  });
  try {
    return work();
  } catch (...) { throw failed(job, current_error(), saved, view, log); }
}

/// How a training is followed: on the terminal, by pictures in its folder, and in the browser where that is wanted.
struct Watched {
  int64_t& saved;  // the step of the last checkpoint
  TrainingPreviews& previews;
  ProgressView& view;
  bool verbose;
  TrainingView* pages;
};

TrainResult train_and_record(TrainJob& job, const TrainRun& run, const TrainOptions& options, const Watched& watched) {
  ProgressView& view = watched.view;
  TrainListener listener;
  listener.step = [&](const StepReport& report) {
    job.record.step = report.progress.step;
    view.step(report);
    watched.previews.after_step(report, job.folder);
    if (watched.pages) watched.pages->step(report);
  };
  listener.checkpoint = [&](int64_t step, const fs::path& path) {
    watched.saved = step;
    view.checkpoint(step, path, watched.verbose);
  };
  listener.warning = [&](const std::string& warning) { view.warning(warning); };
  const StopOnSignal signals("finishing this step, then saving");
  const TrainResult result = train(run, options, listener);
  view.finish();
  end_record(job, result);
  return result;
}

void log_end(const TrainJob& job, const TrainResult& result, EventLog& log) {
  log.write("end", {{"state", job.record.state},
                    {"step", result.step},
                    {"horizon", result.horizon},
                    {"loss", result.loss},
                    {"seconds", result.seconds},
                    {"checkpoint", result.checkpoint.filename().string()}});
}

/// The address is told whatever else is not: nothing is seen without it.
std::unique_ptr<TrainingView> followed(TrainJob& job, const Scene& scene, int port) {
  auto pages = std::make_unique<TrainingView>(
      FollowedTraining{job.folder.lexically_normal().string(), job.record, scene, *job.method, port});
  std::fprintf(stderr, "follow the training in a browser of this computer: %s\n", pages->address().c_str());
  return pages;
}

/// A hundred logs are large: while a training goes on only the method has them, at rest. What reading them took goes
/// back to the system.
void let_go(Scenes& scenes) {
  scenes = {};
  malloc_trim(0);
}

/// Where data are many, reading them takes minutes.
CapturesTold news_of(ProgressView& view) {
  return [&view](const std::string& what, std::size_t done, std::size_t all) {
    view.waiting(text(what, " ", done, " of ", all, " captures"));
  };
}

Scenes give_data_with_news(TrainJob& job, Captures captures, ProgressView& view) {
  Scenes scenes = give_data(job, std::move(captures), [&view](std::size_t done, std::size_t all) {
    view.waiting(text("sweeps of ", done, " of ", all, " captures"));
  });
  view.finish();
  return scenes;
}

std::optional<LoadedCheckpoint> checkpoint_of(const TrainJob& job, const TrainRequest& request, ProgressView& view) {
  if (!request.resume) return std::nullopt;
  return checkpoint_to_go_on(job, [&](const std::string& warning) { view.warning(warning); });
}

/// A rank beside the first: it trains along, and writes nothing.
int train_along(TrainJob& job, Captures captures, const TrainRequest& request, ProgressView& view) {
  job.source.reset();
  Scenes scenes = give_data_with_news(job, std::move(captures), view);
  let_go(scenes);
  meet(ranks());
  const auto checkpoint = checkpoint_of(job, request, view);
  take_progress(job, checkpoint, request);
  TrainRun run{*job.method, RunPaths{job.folder}.checkpoints(), {}};
  run.resume = checkpoint ? &checkpoint->file : nullptr;
  run.stop = &stop_signal;
  const StopOnSignal signals(nullptr);
  const TrainResult result = train(run, options_here(job, request), {});
  return result.interrupted && result.step < result.end ? 128 + stop_signal.load() : 0;
}

/// What the first rank does for all.
void leave_to_first(TrainRequest& request, Common& common) {
  request.progress = "none";
  request.pictures = "off";
  request.view.reset();
  request.tensorboard = false;
  common.quiet = true;
}

/// From here on files are written. Everything was read and checked before.
int train_in_folder(TrainJob& job, Captures captures, const std::vector<DataNow>& now, const TrainRequest& request,
                    const Common& common, EventLog& log, ProgressView& view) {
  Scenes scenes = job.source ? std::move(job.source->scenes) : Scenes();
  job.source.reset();  // loaded long since, and large
  const PreviewWish wish = request.pictures == "off" ? PreviewWish{true} : preview_wish(request.preview_every);
  std::optional<Previews> previews;
  if (as<RendersViews>(*job.method) && !captures.empty() && !wish.off)
    previews.emplace(*job.method, preview_frame(captures), job.folder, log);
  if (Scenes given = give_data_with_news(job, std::move(captures), view); !given.empty()) scenes = std::move(given);
  meet(ranks());  // the others have looked at the folder as it was
  const FolderLock lock(job.folder);
  if (!request.resume) check_folder(job.folder, request.overwrite);  // another process may have been quicker
  auto pages = request.view ? followed(job, scenes.front(), *request.view) : nullptr;
  const auto checkpoint = checkpoint_of(job, request, view);
  take_progress(job, checkpoint, request);
  int64_t saved = job.record.step;
  begin_record(job, now, request.overwrite, command_line());
  const TrainOptions options = options_here(job, request);
  TrainingPreviews while_training(previews ? &*previews : nullptr, wish, view);
  std::optional<TensorBoardFile> event_file;
  const TrainResult result = recorded(job, saved, view, log, [&] {
    write_settings(job, scenes);
    let_go(scenes);
    mend_log(RunPaths{job.folder}.events());
    log.open(RunPaths{job.folder}.events());
    if (request.tensorboard || !event_files(job.folder).empty()) {
      event_file.emplace(job.folder, job.record.step);
      log.also = [&](const std::string& name, const Event& fields) { event_file->take(name, fields); };
    }
    log.write("start", {{"step", job.record.step}, {"command_line", command_line()}, {"device", job.record.device}});
    TrainRun run{*job.method, RunPaths{job.folder}.checkpoints(), checkpoint_metadata(job.record)};
    run.resume = checkpoint ? &checkpoint->file : nullptr;
    run.stop = &stop_signal;
    return train_and_record(job, run, options, {saved, while_training, view, common.verbose, pages.get()});
  });
  pages.reset();                              // what it shows is about to be used
  const int stopped_by = stop_signal.load();  // whoever makes pictures begins anew
  std::optional<Error> trouble;
  if (request.pictures == "on") {
    const double seconds = time_for_pictures(result, job.record.time_budget_seconds);
    const StopOnSignal signals("finishing this picture");
    if (seconds > 0)
      trouble = try_pictures([&] { make_last_pictures(job, previews ? &*previews : nullptr, seconds, common); });
  }
  log_end(job, result, log);
  if (request.pictures == "on" && !trouble) trouble = try_pictures([&] { write_report(job, common); });
  tell_end(job, result, common);
  if (trouble) throw Error(*trouble);
  const bool ended_early = result.interrupted && job.record.state != "finished";
  return ended_early ? 128 + stopped_by : 0;
}

void resolve_alias(TrainRequest& request, const Common& common) {
  const std::string method = method_of_alias(request.method);
  if (method == request.method) return;
  say(common, text(request.method, " is called ", method, " here: training ", method));
  request.method = method;
}

/// Where the data lie now, into the record of a run that is not trained any more.
void record_places(TrainJob& job, const Common& common) {
  Captures captures;
  for (const fs::path& data : job.data)
    if (!job.source) captures.push_back({read_scene_as_listed(data, job.record.reading), {}, {}, {}});
  const std::vector<DataNow> now = data_now(job, captures);
  check_data_unchanged(job, now);
  const FolderLock lock(job.folder);
  note_places(job, now);
  write_record(job.folder, job.record);
  for (const DataNow& data : now) say(common, text("recorded: the run's data is in ", data.root.string()));
}

int end_finished(TrainJob& job, const Common& common) {
  if (!job.data.empty()) record_places(job, common);
  const std::string folder = quoted(job.folder.string());
  say(common, text(job.folder.string(), " is finished (", job.record.step, " steps): nothing to do.\nnext: cloam eval ",
                   folder, ", or to train further: cloam train --resume ", folder, " --steps ", 2 * job.record.step));
  return 0;
}

int run_train(TrainRequest request, const Common& given) {
  Common common = given;
  const bool first = ranks().rank() == 0;
  request.ranks = ranks().size();
  if (!first) leave_to_first(request, common);
  choose_rank_device(request.devices, common);
  resolve_alias(request, common);
  preview_wish(request.preview_every);  // typing errors are told first
  request.networks = networks_named(request.networks);
  request.prior = prior_named(request.prior);
  if (request.resume && request.out.empty())
    throw Error(Fault::usage, "--resume needs a run folder: cloam train --resume RUN");
  if (request.view && (*request.view < 0 || *request.view > 65535))
    throw Error(Fault::usage, "--view takes a port from 1 to 65535, or nothing: cloam train nerf DATA --view");
  if (request.planned_ranks > 0 && !request.dry_run)
    throw Error(Fault::usage, text("--ranks ", request.planned_ranks,
                                   " predicts and does not train\n  fix: add --dry-run; mpirun -n ",
                                   request.planned_ranks, " cloam train trains on as many devices"));
  if (request.planned_ranks == 0 && request.link != TrainRequest().link)
    throw Error(Fault::usage, text("--link ", request.link,
                                   ": used with --dry-run --ranks N alone, which predict the time on N devices"));
  const ProgressStyle style = progress_style(request.progress, common);
  TrainJob job = request.resume ? resumed_job(request) : new_job(request, listener_of(common));
  if (job.finished) return first ? end_finished(job, common) : 0;
  if (request.resume && job.record.shares != job.shares_before)
    warn(text("from here on a step's batch is split into ", job.record.shares, " instead of ", job.shares_before,
              " shares: the run will not be the same bytes as one that goes on as it began"));
  open_device(common);
  EventLog log(style == ProgressStyle::jsonl);
  ProgressView view(style, log);
  const uint64_t host_bytes = request.host_memory.empty() ? default_host_budget() : parse_bytes(request.host_memory);
  auto [captures, now] = read_input(job, request, host_bytes, news_of(view));
  view.finish();
  tell_plan(job, captures, host_bytes, common, log);
  if (!request.dry_run && !first) return train_along(job, std::move(captures), request, view);
  if (!request.dry_run) return train_in_folder(job, std::move(captures), now, request, common, log, view);
  if (request.planned_ranks > 0) {
    (void)give_data_with_news(job, std::move(captures), view);
    const auto checkpoint = checkpoint_of(job, request, view);
    tell_scale(job, {request.planned_ranks, request.link, checkpoint ? &checkpoint->file : nullptr}, common, log);
  }
  say(common, "dry run: nothing was written");
  return 0;
}

void add_method_options(const Options& add, TrainRequest& r) {
  add("METHOD", r.method, joined(method_names())).offers(method_names());
  add("DATA", r.data, "Folder of the capture; several driving logs make one run; for diffusion, a genassets run");
  add.group("Method");
  add("--preset", r.preset,
      "Settings to begin with, such as genassets-small (the method's name); a shell completes them")
      .offers(preset_names());
  add("--networks", r.networks,
      "Freeze the networks of this genassets run (or: shipped) and learn only what is new in DATA");
  add("--prior", r.prior, "With --networks: a diffusion run trained on it (or: shipped), as a prior for new actors");
  add("--config", r.config_file, "TOML file with settings");
  add("--set", r.settings, "Setting key=value, may be repeated; --dry-run -v and RUN/config.toml list the keys")
      .one_word();
}

void add_run_options(const Options& add, TrainRequest& r) {
  add.group("Run");
  add("-o,--out", r.out, "Run folder (default runs/DATA-METHOD)");
  add("--steps", r.steps, "Number of steps, over which learning rates and other schedules run", whole_number(1));
  add("--time-budget", r.time_budget, "Stop within this time (90s, 5m, 1h30m), start-up included", duration())
      .shown_as("TEXT");
  add("--stop-after", r.stop_after, "Save and stop after this step; --resume continues", whole_number(1));
  add("--save-every", r.save_every, "Save a checkpoint every N steps", whole_number(1));
  add("--seed", r.seed, "Random seed (42)", whole_number(0));
  add("--precision", r.precision,
      "full, or mixed (genassets, diffusion): convolutions keep their inputs in 16 bits (full)",
      one_of({"full", "mixed"}));
  add("--gradient-accumulation", r.accumulation,
      "Split each step's batch into N shares, computed one after the other (1)", whole_number(1, kMostShares));
  add("--overwrite", r.overwrite, "Replace an existing run in the folder");
  add("--preview-every", r.preview_every,
      "Steps or time (500, 30s) between previews; off; auto: at most 2 % of the time (auto)");
  add("--pictures", r.pictures, "off: no previews, curves, turntable and report (on)", one_of({"on", "off"}));
  add("--tb", r.tensorboard, "Also write event files for TensorBoard to the run folder");
  add("--devices", r.devices,
      "With mpirun: the devices of a host's ranks in turn, such as 0:0,0:1 (its GPUs of one kind)");
  add("--dry-run", r.dry_run, "Check the data and show the plan; write nothing");
  add("--ranks", r.planned_ranks, "With --dry-run: measure some steps and predict the time of training on N devices",
      whole_number(1, kMostShares));
  add("--link", r.link, "With --ranks: speed of each device's link, such as 12GB a second or 800Mb (100Gb)");
  add("--progress", r.progress, "auto, bar, plain, jsonl or none", one_of({"auto", "bar", "plain", "jsonl", "none"}));
  add.with_or_without("--view", "[PORT]", "Follow the training in the browser, at an address that is printed",
                      [&r](const std::string& port) { r.view = port.empty() ? 0 : number_in<int>(port).value_or(-1); });
  // The run folder may be told by it or by -o.
  add.with_or_without("--resume", "[RUN]", "Continue a run that was interrupted or stopped",
                      [&r](const std::string& run) {
                        r.resume = true;
                        if (r.out.empty()) r.out = run;
                      });
}

void add_data_options(const Options& add, TrainRequest& r) {
  add.group("Data");
  add("--downscale", r.downscale, "Shrink the images by this factor (1)", whole_number(1, 256));
  add("--holdout", r.holdout, "Hold out every Nth image, ordered by name", whole_number(2, 1 << 20));
  add("--skip-bad", r.skip_bad, "Skip damaged images with a warning");
  add_allow_outside(add, r.allow_outside);
  add("--actors", r.actors, "Boxes that become assets: road-users (the default: vehicles and pedestrians), or all",
      one_of({"road-users", "all"}));
  add("--masks", r.masks, "What black mask pixels mean: ignore (the default), or transparent (empty space)",
      one_of({"ignore", "transparent"}));
  add("--protocol", r.protocol, "Driving logs: choose the training images by sparse, novel or rotate360",
      one_of(protocol_names()));
  add("--sparse-every", r.sparse_every, "With --protocol sparse: steps between training images",
      whole_number(2, 1 << 20));
  add("--image", r.image, "Driving log: train on one image, such as front_camera/05, and its LiDAR sweep");
  add("--host-memory", r.host_memory,
      "Host memory for images and sweeps, such as 4G (half of what is free, 15 % beside a CPU)");
  add("--data", r.new_data, "With --resume: where the data is now; repeat for each folder of the run").one_word();
}

}  // namespace

Command add_train(CLI::App& program) {
  return command<TrainRequest>(program, "train", kTrainExamples, run_train, [](const Options& add, TrainRequest& r) {
    add_method_options(add, r);
    add_run_options(add, r);
    add_data_options(add, r);
  });
}

}  // namespace cloam
