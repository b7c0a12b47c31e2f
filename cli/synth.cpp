// cloam synth: streets that it makes itself, as driving logs with the truth beside them.
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "cli/commands.h"
#include "cli/progress.h"
#include "cli/stop_signal.h"
#include "models/data/pandaset.h"
#include "models/io/words.h"
#include "models/synth/street_log.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr char kSynthExamples[] =
    R"(Make synthetic driving logs in PandaSet's layout, with ground truth: actor masks, depth, and
the same frames with all actors rotated. Equal options give equal bytes.

Examples:
  cloam synth -o streets
  cloam synth -o streets --logs 8 --frames 20 --night 0.25
  cloam synth -o recorded --logs 2 --as-recorded
  cloam synth -o streets --logs 2 --size 160x90 --cameras front,front_left,back
  cloam check streets/001)";

struct SynthRequest {
  std::string out, cameras = "front,front_left", size = "320x180";
  int logs = 2;
  double night = 0.25;
  bool no_truth = false, overwrite = false;
  StreetLogOptions log;
};

/// "front,left_camera": names with or without _camera.
std::vector<std::string> camera_list(const std::string& list) {
  std::vector<std::string> cameras, known;
  for (const std::string name : kPandasetCameras) known.push_back(name.substr(0, name.size() - 7));
  for (const std::string& given : comma_separated(list)) {
    const std::string ending = "_camera";
    const bool ends = given.size() > ending.size() && given.ends_with(ending);
    const std::string name = ends ? given.substr(0, given.size() - ending.size()) : given;
    if (std::find(known.begin(), known.end(), name) == known.end()) {
      throw Error(Fault::usage, text("--cameras ", list, ": there is no camera '", given, "'; want some of ",
                                     joined(known), did_you_mean(name, known)));
    }
    if (std::find(cameras.begin(), cameras.end(), name + ending) == cameras.end()) cameras.push_back(name + ending);
  }
  return cameras;
}

fs::path log_folder(const SynthRequest& request, int log) {
  return fs::path(request.out) / std::to_string(1001 + log).substr(1);
}

/// What write_street_log makes in a log's folder.
void remove_log(const fs::path& folder) {
  std::error_code error;
  for (const char* part : {"camera", "lidar", "annotations", "meta", "truth"}) fs::remove_all(folder / part, error);
  fs::remove(folder, error);  // if nothing else is in it
}

/// Logs of an earlier call must not mix with these.
void check_folders(const SynthRequest& request) {
  for (int log = 0; log < request.logs; ++log) {
    const fs::path folder = log_folder(request, log);
    std::error_code error;
    if (!fs::exists(folder, error)) continue;
    if (!request.overwrite) {
      throw Error(Fault::usage, text(folder.string(), " exists; add --overwrite, or name another folder with -o"));
    }
    remove_log(folder);
  }
}

/// On a terminal after each picture, elsewhere a line a log.
class PictureProgress {
 public:
  PictureProgress(int pictures, const Common& common) : pictures_(pictures), common_(common), line_(common) {}

  void count(const fs::path& log) {
    ++done_;
    line_.draw(line(log));
  }
  void end_log(const fs::path& log) {
    if (!line_.on_terminal()) say(common_, line(log));
  }

 private:
  std::string line(const fs::path& log) const {
    const double left = (seconds_since_start() - start_) / done_ * (pictures_ - done_);
    return text(log.string(), "  ", done_, "/", pictures_, " pictures, ", words_for_seconds(left), " left    ");
  }

  int pictures_, done_ = 0;
  const Common& common_;
  RewrittenLine line_;
  const double start_ = seconds_since_start();
};

/// Ends the command after a signal, without the log that it was at.
void check_stop_in(const fs::path& folder, const SynthRequest& request, std::size_t complete) {
  check_stop([&] {
    remove_log(folder);
    return text(complete, " of ", request.logs, " logs are complete in ", request.out,
                "; the incomplete one was removed");
  });
}

int run_synth(SynthRequest request, const Common& common) {
  request.log.cameras = camera_list(request.cameras);
  const ImageSize size = parse_size(request.size);
  request.log.width = size.width, request.log.height = size.height;
  request.log.truth = !request.no_truth;
  check_folders(request);
  std::vector<std::string> folders;
  {
    const StopOnSignal signals("finishing this picture");
    PictureProgress progress(request.logs * street_log_pictures(request.log), common);
    for (int log = 0; log < request.logs; ++log) {
      const fs::path folder = log_folder(request, log);
      StreetLogOptions options = request.log;
      options.seed = street_log_seed(request.log.seed, log);
      options.dead_lidar = options.as_recorded && log == 0;
      options.night = street_log_night(request.log.seed, log, request.night);
      write_street_log(folder, options, [&] {
        progress.count(folder);
        check_stop_in(folder, request, folders.size());
      });
      progress.end_log(folder);
      folders.push_back(folder.string());
    }
  }
  if (common.json) put_json({{"schema_version", 1}, {"logs", folders}});
  say(common, text(request.logs, " logs in ", request.out, ". next: cloam check ", quoted(folders.front())));
  return 0;
}

}  // namespace

Command add_synth(CLI::App& program) {
  return command<SynthRequest>(program, "synth", kSynthExamples, run_synth, [](const Options& add, SynthRequest& r) {
    add("-o,--out", r.out, "Folder for the logs 001, 002, ...").required();
    add("--logs", r.logs, "Number of logs (2)", whole_number(1, 999));
    add("--frames", r.log.frames, "Time steps of each log (20)", whole_number(1, 200));
    add("--rate", r.log.rate, "Steps per second (10); at lower rates, more sides of the actors are seen",
        number_from(1, 10));
    add("--seed", r.log.seed, "Random seed (0)", whole_number(0));
    add("--cameras", r.cameras, "List of front, front_left, front_right, left, right, back (front,front_left)");
    add("--size", r.size, "Image size, WIDTHxHEIGHT (320x180)");
    add("--night", r.night, "Fraction of the logs that are at night, 0 to 1 (0.25)", number_from(0, 1));
    add("--clouds", r.log.clouds, "By day: 0 for a clear sky, 1 for an overcast one without shadows (0)",
        number_from(0, 1));
    add("--beams", r.log.beams, "Number of LiDAR beams (32)", whole_number(1, 256));
    add("--rolling-shutter", r.log.rolling_shutter, "Expose images over 30 ms from top to bottom, sweeps over 100 ms");
    add("--sway", r.log.sway, "Degrees that the car's heading sways to either side, once a second: fast turns (0)",
        number_from(0, 20));
    add("--aside", r.log.aside,
        "Shift moving actors to their right by so many metres (0): the ground truth for edits of the same log without "
        "it",
        number_from(-3, 3));
    add("--as-recorded", r.log.as_recorded,
        "As real logs are: sweeps stamped at their end, staggered cameras, a second LiDAR, returns of the car itself; "
        "in log 001 the LiDAR's poses are wrong");
    add("--no-truth", r.no_truth, "Write no masks, depth or rotated actors");
    add("--overwrite", r.overwrite, "Replace existing logs");
  });
}

}  // namespace cloam
