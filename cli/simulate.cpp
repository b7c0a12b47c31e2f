// cloam simulate: an edited street as a driving log: images rendered, LiDAR measured where the edit touches it.
#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>

#include "cli/commands.h"
#include "cli/ranks.h"
#include "cli/shipped.h"
#include "cli/stop_signal.h"
#include "models/data/read_scene.h"
#include "models/io/host_random.h"
#include "models/runs/actor_names.h"
#include "models/runs/asset_maker.h"
#include "models/runs/captures.h"
#include "models/runs/new_folder.h"
#include "models/runs/shared_work.h"
#include "models/runs/simulated_log.h"
#include "models/scene/asset_class.h"
#include "runtime/error.h"

namespace cloam {
namespace {

using Report = nlohmann::ordered_json;

constexpr char kSimulateExamples[] =
    R"(Write a trained, edited street as a driving log in PandaSet's layout: consistent images, LiDAR and boxes.

Examples:
  cloam simulate runs/edited -o logs/without_car
  cloam simulate runs/edited -o logs/small --log 1 --cameras front_camera --size 320x180
  cloam check logs/without_car
  cloam simulate runs/street --augment 20 --prior runs/assets -o logs/augmented   20 logs with other vehicles

Every frame's image is rendered. LiDAR returns that the edit does not affect stay as recorded; where an actor was, they come
from what is behind it; where it is now, they come from the actor. docs/formats.md says how.

--augment N writes N logs, DIR/001 and so on: the same street and trajectories, but every vehicle is replaced by a new asset
of its class for the log's time of day, as replace=generated of cloam edit does.)";

struct SimulateRequest {
  std::string run, out, log, cameras, size, data, prior;
  int augment = 0;
  bool allow_outside = false;
  MakerRequest wish;
};

void check_log(const Scene& log, const std::string& run) {
  if (log.is_log && !log.frames.empty()) return;
  throw Error(Fault::usage, text("the run ", run, " is of photos, not of a driving log; simulate needs a log"));
}

Report report_of(const LogCount& count) {
  return {{"images", count.images},          {"sweeps", count.sweeps},           {"returns", count.returns},
          {"rays_measured", count.measured}, {"returns_changed", count.changed}, {"returns_gone", count.gone}};
}

std::string words_for(const LogCount& count) {
  return text(count.images, " images, ", count.sweeps, " sweeps with ", count.returns, " returns (", count.changed,
              " changed, ", count.gone, " gone)");
}

class Simulation {
 public:
  Simulation(const SimulateRequest& request, const Common& common, SimulatedLog log)
      : request_(request), common_(common), log_(std::move(log)) {}

  /// Writes the log of the run as its scenes have it; ranks share images and sweeps.
  LogCount write(const RestoredRun& run, const fs::path& folder) {
    const Listener listener = listener_of(common_);
    const Scene out = output_log(run, log_, listener);
    const SimulatedLogWriter writer(run, log_, out, folder);
    const auto logs = static_cast<std::size_t>(std::max(1, request_.augment));
    images_.all = logs * writer.images();
    sweeps_.all = logs * writer.sweeps();
    const std::size_t parts = writer.images() + writer.sweeps(), before = images_.before + sweeps_.before;
    const auto make = [&](std::size_t part) { return packed(std::vector<LogCount>{write_part(writer, part)}); };
    const auto complete = [&](std::size_t done) {
      return text(before + done, " of ", logs * parts, " images and sweeps were made");
    };
    const StopOnSignal signals("finishing this image or sweep");
    LogCount count;
    try {
      for (const Report& made : share_out(ranks(), listener, {parts, make, complete}))
        count += unpacked<LogCount>(made).front();
      if (ranks().rank() == 0) writer.write_rest();
    } catch (const Interrupted& interrupted) {
      remove_new(folder);
      throw Interrupted(interrupted.signal(),
                        text(interrupted.what(), "; ", folder.string(), " was incomplete and has been removed"));
    } catch (const Error&) {
      remove_new(folder);
      throw;
    }
    images_.before += writer.images();
    sweeps_.before += writer.sweeps();
    return count;
  }

 private:
  static void remove_new(const fs::path& folder) {
    std::error_code error;
    if (ranks().rank() == 0) fs::remove_all(folder, error);
  }

  /// Images or sweeps of all logs.
  struct Work {
    std::size_t before = 0, all = 0;  // in the logs before those of now
    std::size_t number = 0;           // of the last that was made, from 1 on
    std::size_t done = 0;             // by this rank, in so many seconds
    double seconds = 0;
    double left() const {
      return seconds / static_cast<double>(done * static_cast<std::size_t>(ranks().size())) *
             static_cast<double>(all - number);
    }
  };

  LogCount write_part(const SimulatedLogWriter& writer, std::size_t part) {
    const bool is_image = part < writer.images();
    const std::size_t place = is_image ? part : part - writer.images();
    Work& work = is_image ? images_ : sweeps_;
    const auto seconds = [] { return seconds_since_start() - device_stats().build_seconds; };  // kernels: only once
    const double before = seconds();
    const LogCount count = is_image ? writer.write_image(place) : writer.write_sweep(place);
    work.seconds += seconds() - before;
    ++work.done;
    work.number = work.before + place + 1;
    say(common_, text("simulate ", work.number, "/", work.all, "  ",
                      is_image ? writer.image_name(place) : writer.sweep_name(place), "  ", left()));
    return count;
  }

  /// Images and sweeps take different times: what was not measured yet is not guessed.
  std::string left() const {
    if (sweeps_.all == 0) return words_for_seconds(images_.left()) + " left";
    if (images_.done > 0 && sweeps_.done > 0) return words_for_seconds(images_.left() + sweeps_.left()) + " left";
    if (images_.done == 0) return words_for_seconds(sweeps_.left()) + " left for sweeps";
    return text(words_for_seconds(images_.left()), " left for images, then ", sweeps_.all, " sweeps");
  }

  const SimulateRequest& request_;
  const Common& common_;
  const SimulatedLog log_;
  Work images_, sweeps_;
};

int write_one(const SimulateRequest& request, const Common& common, Simulation& simulation, StoredRun stored) {
  const RestoredRun run = restore_run(std::move(stored));
  street_of(run);
  const LogCount count = simulation.write(run, request.out);
  Report report = {{"schema_version", 1}, {"folder", request.out}};
  report.update(report_of(count));
  if (common.json) put_json(report);
  say(common, text("the log is ", request.out, ": ", words_for(count), "\n  cloam check ", quoted(request.out)));
  return 0;
}

int write_augmented(const SimulateRequest& request, const Common& common, int log, Simulation& simulation,
                    const StoredRun& stored) {
  AssetMaker maker(request.prior, stored);
  std::set<int> told;  // once for each class
  const auto left_out = [&](int kind, const std::string& why) {
    if (told.insert(kind).second) warn(text(kAssetClasses[kind], " is not replaced: ", why));
  };
  Report report = {{"schema_version", 1}, {"folder", request.out}, {"logs", Report::array()}};
  for (int number = 1; number <= request.augment; ++number) {
    const MakerRequest wish{HostRandom(request.wish.seed, static_cast<uint64_t>(number)).next() >> 32,
                            request.wish.guidance};
    StoredRun swapped = stored;
    const std::size_t vehicles = swap_vehicles(maker, wish, log, swapped, left_out);
    const fs::path folder = fs::path(request.out) / fmt::format("{:03}", number);
    const LogCount count = simulation.write(restore_run(std::move(swapped)), folder);
    Report row = {{"folder", folder.string()}, {"seed", wish.seed}, {"vehicles", vehicles}};
    row.update(report_of(count));
    report["logs"].push_back(row);
    say(common, text(folder.string(), ": ", vehicles, " vehicles swapped, ", words_for(count)));
  }
  if (common.json) put_json(report);
  say(common, text(request.augment, " logs in ", request.out, "\n  cloam check ",
                   quoted((fs::path(request.out) / "001").string())));
  return 0;
}

/// Before work begins.
void check_request(const SimulateRequest& request) {
  check_has_views(read_record(request.run));
  if (request.augment == 0 && !request.prior.empty())
    throw Error(Fault::usage, "--prior makes the vehicles of --augment N, which is not given");
  if (request.augment == 0 && request.wish != MakerRequest())
    throw Error(Fault::usage, "--seed and --guidance are used with --augment N alone, which is not given");
  if (request.augment > 0) check_is_prior(read_record(request.prior), request.prior);
  check_new_folder(request.out);
}

int run_simulate(SimulateRequest request, const Common& common) {
  if (request.augment > 0 && request.prior.empty()) request.prior = kShipped;
  request.prior = prior_named(request.prior);
  check_request(request);  // a wrong folder is told before a missing device
  meet(ranks());           // the folder was new to all
  const RunRecord record = read_record(request.run);
  const std::vector<std::string> logs = log_names(record);
  const int log = request.log.empty() ? 0 : find_log(logs, request.log);
  open_device(common);
  StoredRun stored = read_run(request.run);
  if (!stored.checkpoint.warning.empty()) warn(stored.checkpoint.warning);
  check_log(stored.scenes.at(static_cast<std::size_t>(log)), request.run);
  const fs::path data = request.data.empty() ? find_data(request.run, record.data.at(static_cast<std::size_t>(log)))
                                             : fs::path(request.data);
  const Reading how = reading_for(record, !request.data.empty(), request.allow_outside);
  SimulatedLog wish{log, read_scene(data, {how.skip_bad, how.allow_outside}), {}, {}};
  check_same_data(data, record.data.at(static_cast<std::size_t>(log)), fingerprint(wish.recorded));
  if (!request.cameras.empty()) wish.cameras = comma_separated(request.cameras);
  if (!request.size.empty()) wish.size = parse_size(request.size);
  Simulation simulation(request, common, std::move(wish));
  if (logs.size() > 1) say(common, text("log ", log, " (", logs[static_cast<std::size_t>(log)], ") of ", logs.size()));
  std::optional<NewFolder> folder;
  if (ranks().rank() == 0) folder.emplace(request.out);
  meet(ranks());
  return request.augment > 0 ? write_augmented(request, common, log, simulation, stored)
                             : write_one(request, common, simulation, std::move(stored));
}

}  // namespace

Command add_simulate(CLI::App& program) {
  return command<SimulateRequest>(
      program, "simulate", kSimulateExamples, run_simulate, [](const Options& add, SimulateRequest& r) {
        add("RUN", r.run, "Run folder, edited or not").required();
        add("-o,--out", r.out, "Folder for the log; with --augment, for the logs").required();
        add("--log", r.log, "Number or name of one of the run's logs (0)");
        add("--cameras", r.cameras, "Cameras, separated by commas (all)");
        add("--size", r.size, "Size of the images, WIDTHxHEIGHT (as trained)");
        add("--augment", r.augment, "Number of logs to write, each with other vehicles in the same places",
            whole_number(1, 100000));
        add("--prior", r.prior, "With --augment: diffusion run that makes the vehicles (shipped)");
        add("--seed", r.wish.seed, "With --augment: random seed (0)", whole_number(0));
        add("--guidance", r.wish.guidance,
            "With --augment: classifier-free guidance; above 1 follows the class more closely (1)",
            number_from(0, 100));
        add("--data", r.data, "New location of the recorded log, if it was moved");
        add_allow_outside(add, r.allow_outside);
      });
}

}  // namespace cloam
