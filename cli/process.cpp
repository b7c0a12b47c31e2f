// cloam process: photos or a video become a capture. COLMAP finds the poses; we choose, watch and lay out.
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
#include "cli/process_photos.h"
#include "cli/progress.h"
#include "cli/stop_signal.h"
#include "cli/video_frames.h"
#include "models/data/colmap.h"
#include "models/data/colmap_model.h"
#include "models/data/near_misses.h"
#include "models/data/read_scene.h"
#include "models/io/commit.h"
#include "models/io/image.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr char kProcessExamples[] =
    R"(Find the camera poses of photos, or of the frames of a video, with COLMAP (apt-get install colmap), on the CPU.
Of a video ffmpeg takes the sharpest frame of each half second (apt-get install ffmpeg).
The result is a capture for train and check: images/, and sparse/0 with cameras, poses and points.

Examples:
  cloam process photos -o data/walk                            # also HEIC; turned as EXIF says
  cloam process walk.mp4 -o data/walk                          # a video: mp4, mov, mkv, webm, ...
  cloam process walk.mp4 -o data/walk --frames 200             # the sharpest of 200 equal parts
  cloam process photos -o data/walk --camera-model OPENCV --undistort)";

constexpr std::size_t kMaxExhaustive = 150;  // images: the pairs to match grow with the square
constexpr std::size_t kMostCameras = 16;     // else each photo has one of its own, as a zoom lens needs

struct ProcessRequest {
  std::string images, out, matching = "auto", camera_model = "SIMPLE_RADIAL";
  std::optional<double> fps;
  std::optional<int> frames;
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
  fs::path upright() const { return work() / "upright"; }
  fs::path frames() const { return work() / "frames"; }
  /// What the database is of.
  fs::path source() const { return work() / "source.json"; }
  fs::path log() const { return work() / "log.txt"; }
};

/// The video that was named in the place of a folder; nothing for a folder.
std::optional<Video> video_of(const ProcessRequest& request) {
  const fs::path given = request.images;
  std::error_code error;
  if (!fs::exists(given, error)) throw Error(Fault::data, "no such folder or video: " + given.string());
  if (fs::is_directory(given, error)) {
    if (request.fps || request.frames)
      throw Error(Fault::usage, text("--fps and --frames choose frames of a video; ", given.string(), " is a folder"));
    return std::nullopt;
  }
  if (request.fps && request.frames) throw Error(Fault::usage, "give either --fps or --frames, not both");
  if (is_image_name(given) || is_heic_name(given))
    throw Error(Fault::data, given.string() + ": is a photo; give the folder of the photos");
  return read_video(given);
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
    const bool placed_none =
        end.said.find("failed to create sparse model") != std::string::npos;  // found_models tells it
    if (end.code == 0 || placed_none || stop_signal.load() != 0) return;
    const std::string name = "colmap " + stage.words.front();
    if (end.is_of_full_disk())
      throw Error(Fault::write, text(name, " cannot write: ", space_advice(layout.work()), "; it printed:", end.said));
    const char* smaller = end.code == -SIGKILL ? "\n  fix: --max-size 1000 needs less memory" : "";
    throw Error(Fault::data, text(name, " ", end.in_words(), smaller, "\n  full output: ", layout.log().string()));
  }
};

/// One for each camera, so that all of its photos share what is found of its lens.
std::vector<Stage> feature_stages(const ProcessRequest& request, const Layout& layout, const ProcessPhotos& photos) {
  const std::size_t count = photos.cameras.size() > kMostCameras ? 1 : photos.cameras.size();
  const std::vector<std::string> words = {"feature_extractor",
                                          "--database_path",
                                          layout.database().string(),
                                          "--image_path",
                                          fs::canonical(photos.folder).string(),
                                          "--ImageReader.camera_model",
                                          request.camera_model,
                                          "--ImageReader.single_camera",
                                          count == photos.cameras.size() ? "1" : "0",
                                          "--SiftExtraction.use_gpu",
                                          "0",
                                          "--SiftExtraction.max_image_size",
                                          std::to_string(request.max_size)};
  const auto of_list = [&](const std::string& name, const std::string& told, const std::vector<std::string>& names) {
    const fs::path list = layout.work() / name;
    commit_text(list, joined(names, "\n") + "\n");
    Stage stage{told, words};
    stage.words.insert(stage.words.end(), {"--image_list_path", list.string()});
    return stage;
  };
  if (count == 1 && photos.others) return {of_list("photos.txt", "finding features", photos.names)};
  if (count == 1) return {{"finding features", words}};
  std::vector<Stage> stages;
  for (std::size_t i = 0; i < count; ++i) {
    std::vector<std::string> names;
    for (const std::size_t place : photos.cameras[i]) names.push_back(photos.names[place]);
    stages.push_back(of_list(text("camera", i + 1, ".txt"), text("finding features of camera ", i + 1), names));
  }
  return stages;
}

std::vector<Stage> stages_of(const ProcessRequest& request, const Layout& layout, const ProcessPhotos& photos) {
  const bool few = photos.names.size() <= kMaxExhaustive && photos.folder != layout.frames();
  const bool pairs = request.matching == "exhaustive" || (request.matching == "auto" && few);
  const std::string database = layout.database().string();
  std::vector<Stage> stages = feature_stages(request, layout, photos);
  stages.push_back({pairs ? "matching all pairs" : "matching neighbours",
                    {pairs ? "exhaustive_matcher" : "sequential_matcher", "--database_path", database,
                     "--SiftMatching.use_gpu", "0"}});
  stages.push_back({"placing cameras and points",
                    {"mapper", "--database_path", database, "--image_path", fs::canonical(photos.folder).string(),
                     "--output_path", layout.models().string()}});
  return stages;
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

/// images last: without it the folder is no model yet.
void lay_model(const fs::path& from, const fs::path& to) {
  for (const char* name : {"points3D.bin", "cameras.bin", "images.bin"}) {
    commit_file(to / name,
                [&](const fs::path& temp) { fs::copy_file(from / name, temp, fs::copy_options::overwrite_existing); });
  }
}

void lay_capture(const fs::path& images, const fs::path& model, const Layout& layout) {
  for (const ColmapImage& image : read_colmap_model(model).images)
    commit_link(images / image.name, layout.images() / image.name);
  lay_model(model, layout.model());
}

/// What a database that lies there must be of, lest it holds photos that are no longer given.
nlohmann::json source_of(const ProcessRequest& request) {
  std::error_code error;
  nlohmann::json source = {{"path", fs::canonical(request.images).string()}};
  if (fs::is_directory(request.images, error)) return source;
  source["bytes"] = fs::file_size(request.images);
  source["fps"] = request.fps.value_or(0);
  source["frames"] = request.frames.value_or(0);
  return source;
}

/// Drops what an interrupted run left of something else.
void begin_source(const ProcessRequest& request, const Layout& layout) {
  const nlohmann::json source = source_of(request);
  std::error_code error;
  std::ifstream before(layout.source());
  if (before && nlohmann::json::parse(before, nullptr, false) == source) return;
  for (const fs::path& stale : {layout.database(), layout.frames(), layout.upright()}) fs::remove_all(stale, error);
  commit_text(layout.source(), source.dump() + "\n");
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
  std::fprintf(stderr, "What was found so far is kept in %s; run the same command again to continue from there.\n",
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
    put(fmt::format("{} of {} photos placed; {} points, mean reprojection error {}; {}\n", scene.frames.size(), given,
                    fit.points, error_in_words(fit), words_for_seconds(seconds_since_start())));
  }
  say(common, "next: cloam check " + quoted(layout.root.string()));
}

/// Its frames, taken before if a run was interrupted after that. Empty once stop_signal is set.
ProcessPhotos frames_of(const Video& video, const ProcessRequest& request, const Layout& layout,
                        PhotoProgress& progress) {
  std::error_code error;
  if (!fs::exists(layout.frames(), error))
    take_frames(
        video, {request.fps.value_or(2), request.frames.value_or(0)}, layout.frames(),
        {[&](const std::string& stage) { progress.begin(stage); }, [&](double share) { progress.draw(share); }});
  progress.end_line();
  return stop_signal.load() == 0 ? photos_in(layout.frames(), layout.root) : ProcessPhotos{};
}

/// What COLMAP is to see.
ProcessPhotos prepared(const std::optional<Video>& video, const ProcessRequest& request, const Layout& layout,
                       ProcessPhotos photos, const Common& common) {
  std::error_code error;
  const bool take = video && !fs::exists(layout.frames(), error);
  PhotoProgress progress(common, take ? kFrameStages : 1);
  if (video) photos = frames_of(*video, request, layout, progress);
  if (!photos.need_copies || stop_signal.load() != 0) return photos;
  progress.begin("turning photos upright");
  photos = upright_copies(photos, layout.upright(), [&](double share) { progress.draw(share); });
  progress.end_line();
  return photos;
}

int run_process(const ProcessRequest& request, const Common& common) {
  const std::optional<Video> video = video_of(request);
  ProcessPhotos photos = video ? ProcessPhotos{} : photos_in(request.images, request.out);
  const fs::path program = colmap_program();
  const Layout layout{request.out};
  prepare_folder(request, layout);
  const FolderLock lock(layout.work());
  begin_source(request, layout);
  const StopOnSignal signals("ending COLMAP");
  if (video) say(common, video->file.string() + ": " + in_words(*video));
  photos = prepared(video, request, layout, photos, common);
  if (stop_signal.load() != 0) return interrupted(layout);
  say(common, text(photos.names.size(), " photos, ",
                   photos.cameras.size() == 1 ? "one camera" : text(photos.cameras.size(), " cameras")));
  const std::vector<Stage> stages = stages_of(request, layout, photos);
  PhotoProgress progress(common, static_cast<int>(stages.size()) + (request.undistort ? 1 : 0));
  Colmap colmap{program, layout, photos.names.size(), progress, common.verbose};
  for (const Stage& stage : stages) {
    colmap.run(stage);
    if (stop_signal.load() != 0) return interrupted(layout);
  }
  const std::vector<FoundModel> models = found_models(layout.models());
  fs::path images = photos.folder, model = models.front().folder;
  if (request.undistort) {
    colmap.run({"undistorting",
                {"image_undistorter", "--image_path", fs::canonical(images).string(), "--input_path", model.string(),
                 "--output_path", layout.straight().string(), "--output_type", "COLMAP"}});
    if (stop_signal.load() != 0) return interrupted(layout);
    images = layout.straight() / "images";
    model = layout.straight() / "sparse";
  }
  lay_capture(images, model, layout);
  tell_result(layout, photos.names.size(), models.size(), common);
  return 0;
}

}  // namespace

Command add_process(CLI::App& program) {
  return command<
      ProcessRequest>(program, "process", kProcessExamples, run_process, [](const Options& add, ProcessRequest& r) {
    add("IMAGES", r.images, "Folder of photos (JPEG, PNG, HEIC), including its subfolders, or a video").required();
    add("-o,--out", r.out, "Output folder for the capture").required();
    add("--fps", r.fps, "Of a video: the sharpest frame of each part, that many parts a second (2)",
        number_from(0.01, 240));
    add("--frames", r.frames, "Of a video: that many parts in all, of equal length, instead",
        whole_number(kFewestPhotos, 5000));
    add("--matching", r.matching,
        "exhaustive (all pairs), sequential (neighbours by name), auto (all pairs up to 150 photos, neighbours in a "
        "video) (auto)",
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
