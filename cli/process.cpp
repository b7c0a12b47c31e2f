// cloam process: photos become a capture. COLMAP finds the poses; we choose, watch and lay out.
#include <fmt/format.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "cli/child_program.h"
#include "cli/commands.h"
#include "cli/progress.h"
#include "cli/stop_signal.h"
#include "models/data/colmap.h"
#include "models/data/colmap_model.h"
#include "models/data/near_misses.h"
#include "models/data/read_scene.h"
#include "models/io/commit.h"
#include "models/io/image.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr char kProcessExamples[] = R"(Find the camera poses of photos with COLMAP (apt-get install colmap), on the CPU.
The result is a capture for train and check: images/, and sparse/0 with cameras, poses and points.

Examples:
  cloam process photos -o data/walk
  cloam process frames -o data/walk --matching sequential      # video frames, in order of name
  cloam process photos -o data/walk --camera-model OPENCV --undistort)";

constexpr std::size_t kMaxExhaustive = 150;  // images: the pairs to match grow with the square
constexpr std::size_t kFewest = 3;

struct ProcessRequest {
  std::string images, out, matching = "auto", camera_model = "SIMPLE_RADIAL";
  int max_size = 1600;
  bool undistort = false, overwrite = false;
};

/// The folder that is made.
struct Layout {
  fs::path root;
  fs::path images() const { return root / "images"; }
  fs::path sparse() const { return root / "sparse"; }
  fs::path model() const { return root / "sparse/0"; }
  fs::path work() const { return root / "colmap"; }
  fs::path database() const { return work() / "database.db"; }
  fs::path models() const { return work() / "sparse"; }
  fs::path straight() const { return work() / "undistorted"; }
  fs::path log() const { return work() / "log.txt"; }
};

/// What was named in the place of a folder.
[[noreturn]] void not_photos(const fs::path& file) {
  if (!is_video_name(file)) throw Error(Fault::data, file.string() + ": is a file; give the folder of the photos");
  throw Error(Fault::data, text(file.string(), ": is a video, not a folder of photos\n  fix: ", frames_command(file),
                                "\n  then: cloam process frames -o DATA --matching sequential"));
}

/// Names below the folder, sorted.
std::vector<std::string> image_names(const fs::path& folder) {
  std::error_code error;
  if (!fs::exists(folder, error)) throw Error(Fault::data, "no such folder: " + folder.string());
  if (!fs::is_directory(folder, error)) not_photos(folder);
  std::vector<std::string> names;
  std::size_t heic = 0;
  fs::path video;
  fs::recursive_directory_iterator entry(folder, error), end;
  if (error == std::errc::permission_denied) throw Error(Fault::data, folder.string() + ": permission denied");
  for (; !error && entry != end; entry.increment(error)) {
    const bool photo = is_image_name(entry->path()) && entry->path().extension() != ".exr";
    if (photo && entry->is_regular_file(error))
      names.push_back(entry->path().lexically_relative(folder).generic_string());
    if (is_video_name(entry->path())) video = entry->path();
    heic += is_heic_name(entry->path());
    if (entry->is_symlink(error) && entry->is_directory(error))
      warn(entry->path().string() + " is a link to a folder, which COLMAP does not follow; its photos are left out");
  }
  if (heic > 0) warn(text(heic, " HEIC photos are left out; ", kConvertHeic));
  std::sort(names.begin(), names.end());
  if (names.size() >= kFewest) return names;
  throw Error(Fault::data,
              text(folder.string(), ": holds ", names.size(), " photos (.jpg, .jpeg, .png), want ", kFewest, " or more",
                   video.empty() ? "" : "\n  fix: take frames from the video: " + frames_command(video)));
}

/// Reads every header: what COLMAP would leave out in silence stops here. True: one camera may have taken them all.
bool all_of_one_size(const fs::path& folder, const std::vector<std::string>& names) {
  const ImageSize first = read_image_size(folder / names.front());
  return std::all_of(names.begin(), names.end(), [&](const std::string& name) {
    const ImageSize size = read_image_size(folder / name);
    return size.width == first.width && size.height == first.height;
  });
}

/// "[3/8" or "Registering image #5 (3)": how much of the stage is done, between 0 and 1.
std::optional<double> share_in(const std::string& line, std::size_t images) {
  const std::size_t bracket = line.find('[');
  int done = 0, all = 0;
  if (bracket != std::string::npos && std::sscanf(line.c_str() + bracket, "[%9d/%9d", &done, &all) == 2 && all > 0)
    return std::min(1.0, static_cast<double>(done) / all);
  const std::size_t registering = line.find("Registering image #");
  if (registering != std::string::npos &&
      std::sscanf(line.c_str() + registering, "Registering image #%9d (%9d", &all, &done) == 2)
    return std::min(1.0, done / static_cast<double>(images));
  return std::nullopt;
}

class PhotoProgress {
 public:
  PhotoProgress(const Common& common, int stages) : common_(common), stages_(stages), line_(common) {}

  void begin(const std::string& stage) {
    line_.end();
    stage_ = text(++number_, "/", stages_, " ", stage);
    if (!line_.on_terminal()) say(common_, stage_);
    draw(0);
  }
  void draw(double share) {
    line_.draw(fmt::format("{}  {:3.0f} %  {} ", stage_, 100 * share, words_for_seconds(seconds_since_start())));
  }
  void end_line() { line_.end(); }

 private:
  const Common& common_;
  int stages_, number_ = 0;
  RewrittenLine line_;
  std::string stage_;
};

struct Stage {
  std::string told;  // "finding features"
  std::vector<std::string> words;
};

struct Colmap {
  fs::path program;
  const Layout& layout;
  std::size_t images;
  PhotoProgress& progress;
  bool verbose;

  /// Ends with the stage done, or with stop_signal set. Fault::data with COLMAP's last words.
  void run(const Stage& stage) {
    progress.begin(stage.told);
    std::ofstream log(layout.log(), std::ios::app);
    if (!log) throw Error(Fault::write, text("cannot open ", layout.log().string(), ": ", std::strerror(errno)));
    log << "\ncolmap";
    for (const std::string& word : stage.words) log << " " << quoted(word);
    log << "\n";
    const auto seen = [&](const std::string& line) {
      log << line << "\n";
      if (verbose) {
        progress.end_line();
        std::fprintf(stderr, "  %s\n", line.c_str());
      }
      if (const auto share = share_in(line, images)) progress.draw(*share);
    };
    const ChildEnd end = run_child({program, stage.words, {"QT_QPA_PLATFORM=offscreen"}}, seen);
    progress.end_line();
    if (!log.flush())
      throw Error(Fault::write, text("cannot write ", layout.log().string(), "; ", space_advice(layout.work())));
    if (end.code == 0 || stop_signal.load() != 0) return;
    const std::string name = "colmap " + stage.words.front();
    if (end.is_of_full_disk())
      throw Error(Fault::write, text(name, " cannot write: ", space_advice(layout.work()), "; it printed:", end.said));
    const char* smaller = end.code == -SIGKILL ? "\n  fix: --max-size 1000 needs less memory" : "";
    throw Error(Fault::data, text(name, " ", end.in_words(), smaller, "\n  full output: ", layout.log().string()));
  }
};

std::vector<Stage> stages_of(const ProcessRequest& request, const Layout& layout, std::size_t images, bool one_camera) {
  const bool pairs = request.matching == "exhaustive" || (request.matching == "auto" && images <= kMaxExhaustive);
  const std::string database = layout.database().string();
  const std::string folder = fs::canonical(request.images).string();
  return {{"finding features",
           {"feature_extractor", "--database_path", database, "--image_path", folder, "--ImageReader.camera_model",
            request.camera_model, "--ImageReader.single_camera", one_camera ? "1" : "0", "--SiftExtraction.use_gpu",
            "0", "--SiftExtraction.max_image_size", std::to_string(request.max_size)}},
          {pairs ? "matching all pairs" : "matching neighbours",
           {pairs ? "exhaustive_matcher" : "sequential_matcher", "--database_path", database, "--SiftMatching.use_gpu",
            "0"}},
          {"placing cameras and points",
           {"mapper", "--database_path", database, "--image_path", folder, "--output_path", layout.models().string()}}};
}

struct FoundModel {
  fs::path folder;
  std::size_t images = 0;
};

/// By the number of their images, the largest first.
std::vector<FoundModel> found_models(const fs::path& folder) {
  std::vector<FoundModel> models;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error)) {
    if (!has_colmap_model(entry->path())) continue;
    models.push_back({entry->path(), read_colmap_model(entry->path()).images.size()});
  }
  std::sort(models.begin(), models.end(), [](const FoundModel& a, const FoundModel& b) {
    return a.images != b.images ? a.images > b.images : a.folder < b.folder;
  });
  if (!models.empty()) return models;
  throw Error(
      Fault::data,
      "COLMAP could not match any two of the photos.\n  fix: take sharp photos that overlap by two thirds, from "
      "several places, of static, textured things; or try --matching exhaustive");
}

/// A second name for the file where that can be, else a copy.
void lay_image(const fs::path& from, const fs::path& to) {
  std::error_code error;
  if (fs::equivalent(from, to, error)) return;
  commit_file(to, [&](const fs::path& temp) {
    std::error_code failed;
    fs::remove(temp, failed);
    const fs::path file = fs::canonical(from);
    fs::create_hard_link(file, temp, failed);
    if (failed) fs::copy_file(file, temp, fs::copy_options::overwrite_existing);
  });
}

/// images last: without it the folder is no model yet.
void lay_model(const fs::path& from, const fs::path& to) {
  for (const char* name : {"points3D.bin", "cameras.bin", "images.bin"}) {
    commit_file(to / name,
                [&](const fs::path& temp) { fs::copy_file(from / name, temp, fs::copy_options::overwrite_existing); });
  }
}

void lay_capture(const fs::path& images, const fs::path& model, const Layout& layout) {
  for (const ColmapImage& image : read_colmap_model(model).images)
    lay_image(images / image.name, layout.images() / image.name);
  lay_model(model, layout.model());
}

void prepare_folder(const ProcessRequest& request, const Layout& layout) {
  std::error_code error;
  if (request.overwrite) {
    fs::remove_all(layout.work(), error);
    fs::remove_all(layout.sparse(), error);
  }
  if (is_colmap(layout.root))
    throw Error(Fault::usage,
                layout.root.string() + " already holds a model; add --overwrite, or choose another folder with -o");
  fs::remove_all(layout.models(), error);
  fs::remove_all(layout.straight(), error);
  fs::create_directories(layout.models(), error);
  if (error) throw Error(Fault::write, text(layout.models().string(), ": cannot be created: ", error.message()));
}

fs::path colmap_program() {
  const fs::path found = find_program("colmap");
  if (!found.empty()) return found;
  throw Error(Fault::usage,
              "COLMAP, which finds the poses, is not installed (no colmap in PATH)\n  fix: apt-get install colmap");
}

int interrupted(const Layout& layout) {
  std::fprintf(stderr,
               "What COLMAP has found so far is kept in %s; run the same command again to continue from there.\n",
               layout.work().c_str());
  return 128 + stop_signal.load();
}

void tell_result(const Layout& layout, std::size_t given, std::size_t models, const Common& common) {
  const Scene scene = read_scene(layout.root);
  const ColmapFit fit = check_colmap(scene.root);
  if (scene.frames.size() < given)
    warn(text("COLMAP could not place ", given - scene.frames.size(), " of ", given, " photos; they are left out"));
  if (models > 1) warn(text("the photos form ", models, " groups that do not overlap; the largest is used"));
  if (common.json) {
    put_json({{"schema_version", 1},
              {"folder", layout.root.string()},
              {"images_given", given},
              {"images", scene.frames.size()},
              {"cameras", scene.cameras.size()},
              {"points", fit.points},
              {"observations", fit.observations},
              {"mean_error_pixels", fit.mean_error},
              {"models", models},
              {"seconds", seconds_since_start()}});
  } else {
    put(fmt::format("{} of {} photos placed; {} points, mean reprojection error {:.2f} px; {}\n", scene.frames.size(),
                    given, fit.points, fit.mean_error, words_for_seconds(seconds_since_start())));
  }
  say(common, "next: cloam check " + quoted(layout.root.string()));
}

int run_process(const ProcessRequest& request, const Common& common) {
  const std::vector<std::string> names = image_names(request.images);
  const bool one_camera = all_of_one_size(request.images, names);
  const fs::path program = colmap_program();
  const Layout layout{request.out};
  prepare_folder(request, layout);
  const FolderLock lock(layout.work());
  const StopOnSignal signals("ending COLMAP");
  say(common, text(names.size(), " photos, ", one_camera ? "one camera" : "several cameras"));
  PhotoProgress progress(common, request.undistort ? 4 : 3);
  Colmap colmap{program, layout, names.size(), progress, common.verbose};
  for (const Stage& stage : stages_of(request, layout, names.size(), one_camera)) {
    colmap.run(stage);
    if (stop_signal.load() != 0) return interrupted(layout);
  }
  const std::vector<FoundModel> models = found_models(layout.models());
  fs::path images = request.images, model = models.front().folder;
  if (request.undistort) {
    colmap.run({"undistorting",
                {"image_undistorter", "--image_path", fs::canonical(images).string(), "--input_path", model.string(),
                 "--output_path", layout.straight().string(), "--output_type", "COLMAP"}});
    if (stop_signal.load() != 0) return interrupted(layout);
    images = layout.straight() / "images";
    model = layout.straight() / "sparse";
  }
  lay_capture(images, model, layout);
  tell_result(layout, names.size(), models.size(), common);
  return 0;
}

}  // namespace

Command add_process(CLI::App& program) {
  return command<ProcessRequest>(
      program, "process", kProcessExamples, run_process, [](const Options& add, ProcessRequest& r) {
        add("IMAGES", r.images, "Folder of photos, including its subfolders").required();
        add("-o,--out", r.out, "Output folder for the capture").required();
        add("--matching", r.matching,
            "exhaustive (all pairs), sequential (neighbours by name), auto (all pairs up to 150 photos) (auto)",
            one_of({"auto", "exhaustive", "sequential"}));
        add("--camera-model", r.camera_model, "COLMAP's camera model, such as OPENCV or OPENCV_FISHEYE (SIMPLE_RADIAL)",
            one_of({"SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE", "FULL_OPENCV",
                    "FOV", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "THIN_PRISM_FISHEYE"}));
        add("--max-size", r.max_size, "Longest image side for finding features (1600)", whole_number(100, 1 << 14));
        add("--undistort", r.undistort, "Undistort the images");
        add("--overwrite", r.overwrite, "Start over in a folder that already holds a model or part of one");
      });
}

}  // namespace cloam
