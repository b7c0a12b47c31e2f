// See object_crops.h.
#include "models/eval/object_crops.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <map>
#include <nlohmann/json.hpp>
#include <numeric>
#include <utility>

#include "models/data/load_images.h"
#include "models/data/reader.h"
#include "models/io/commit.h"
#include "models/io/paths.h"
#include "models/io/words.h"
#include "models/runs/new_folder.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;
using Report = nlohmann::ordered_json;

constexpr char kIndex[] = "crops.json";
constexpr std::size_t kImagesBetweenTells = 20;  // images

struct Log {
  Scene scene;
  std::string name;
  std::vector<std::size_t> frames;  // by step
};

/// Letters, digits and what is harmless in a file's name.
std::string as_file_name(std::string word) {
  for (char& c : word)
    if (!std::isalnum(static_cast<unsigned char>(c)) && c != '-' && c != '_') c = '_';
  return word;
}

std::vector<std::size_t> frames_by_step(const Scene& log, const std::string& split) {
  std::vector<std::size_t> frames;
  if (split != "test") frames = frames_of(log, Split::train);
  if (split != "train")
    for (const std::size_t frame : frames_of(log, Split::test)) frames.push_back(frame);
  std::sort(frames.begin(), frames.end(), [&](std::size_t a, std::size_t b) {
    return std::pair(log.frames[a].step, a) < std::pair(log.frames[b].step, b);
  });
  return frames;
}

Log read_log(const std::string& folder, const CropRequest& request) {
  Log log;
  log.scene = read_split_scene(folder, request.how);
  if (!log.scene.is_log)
    throw Error(
        Fault::usage,
        text(folder, " holds photos, not a driving log: crops need actors with boxes; cloam synth makes a log"));
  log.name = as_file_name(log.scene.root.filename().string());
  log.frames = frames_by_step(log.scene, request.split);
  return log;
}

/// Logs of one name are told apart by the folders that they lie in.
void tell_apart(std::vector<Log>& logs) {
  std::map<std::string, int> count;
  for (const Log& log : logs) ++count[log.name];
  for (Log& log : logs)
    if (count[log.name] > 1) log.name = as_file_name(log.scene.root.parent_path().filename().string()) + "-" + log.name;
}

void check_names(const std::vector<Log>& logs) {
  std::map<std::string, fs::path> known;
  for (const Log& log : logs) {
    const auto [first, is_new] = known.emplace(log.name, log.scene.root);
    if (is_new) continue;
    throw Error(Fault::usage, text(first->second.string(), " and ", log.scene.root.string(), " are both called ",
                                   log.name, ": their crops would be, too; give each call its own -o"));
  }
}

void check_content(const std::vector<Log>& logs, const CropRequest& request) {
  const auto has_actor = [](const Log& log) { return !log.scene.actors.empty(); };
  if (std::none_of(logs.begin(), logs.end(), has_actor))
    bad_data(logs.front().scene.root.string(), logs.size() > 1 ? " and the other logs have" : " has",
             " no actor with a box (annotations/cuboids in PandaSet, tracklet_labels.xml in KITTI, \"actors\" in ",
             "rig.json): there is nothing to crop");
  const auto has_image = [](const Log& log) { return !log.frames.empty(); };
  if (std::any_of(logs.begin(), logs.end(), has_image)) return;
  const bool is_split = request.how.holdout > 0 || !request.how.protocol.name.empty();
  throw Error(Fault::usage, text("--split ", request.split, ": no image of the logs is in that split",
                                 is_split ? "" : "; choose one with --protocol or --holdout"));
}

std::vector<Log> read_logs(const CropRequest& request, const Listener& listener) {
  std::vector<Log> logs;
  for (const std::string& folder : request.logs) {
    logs.push_back(read_log(folder, request));
    for (const std::string& warning : logs.back().scene.warnings) listener.warn(warning);
    if (logs.back().scene.actors.empty()) listener.warn(text(folder, " has no actors: it gives no crops"));
  }
  tell_apart(logs);
  check_names(logs);
  check_content(logs, request);
  return logs;
}

/// Of one log, DIR itself may hold its masks.
ActorMasks masks_of(const Log& log, const CropRequest& request) {
  if (request.masks.empty()) return ActorMasks(log.scene);
  const fs::path all = request.masks, own = all / log.scene.root.filename();
  if (has_file(own / "actors.json")) return ActorMasks::from(log.scene, own);
  if (request.logs.size() == 1 && has_file(all / "actors.json")) return ActorMasks::from(log.scene, all);
  bad_data("--masks ", all.string(), ": found no ", (own / "actors.json").string(),
           request.logs.size() == 1 ? " and no " + (all / "actors.json").string() : "",
           "; want {\"NUMBER IN THE MASKS\": \"ID OF THE ACTOR\", ...} beside the cameras' folders");
}

Report rows_of(const Eigen::Matrix4d& pose) {
  Report rows = Report::array();
  for (int row = 0; row < 4; ++row) {
    rows.push_back(Report::array());
    for (int column = 0; column < 4; ++column) rows.back().push_back(pose(row, column) + 0.0);  // no -0.0
  }
  return rows;
}

Report json_of(const PixelBox& box) { return {box.left, box.top, box.right, box.bottom}; }

/// 001_front_camera_07_car_012: sorted, crops are in the order of logs, cameras, steps, classes and actors.
std::string crop_name(const Log& log, const Frame& frame, const ObjectView& object) {
  const int last = log.scene.frames[log.frames.back()].step;
  const std::size_t digits = std::max<std::size_t>(2, std::to_string(last).size());
  std::string kind = lower_case(kAssetClasses[object.asset_class]);
  std::replace(kind.begin(), kind.end(), ' ', '-');
  return fmt::format("{}_{}_{:0{}}_{}_{:03}.png", log.name, as_file_name(frame.sensor), frame.step, digits, kind,
                     object.actor + 1);
}

/// The lens is as it was.
Report crop_intrinsics(const Camera& camera, const ObjectView& object, int size) {
  const double scale = static_cast<double>(size) / object.square.width();
  return {{"fx", scale * camera.fx},
          {"fy", scale * camera.fy},
          {"cx", scale * (camera.cx - object.square.left)},
          {"cy", scale * (camera.cy - object.square.top)}};
}

class CropWriter {
 public:
  CropWriter(const CropRequest& request, const Listener& listener, std::vector<Log> logs)
      : request_(request), listener_(listener), logs_(std::move(logs)) {
    for (const Log& log : logs_) all_ += log.frames.size();
  }

  CropReport write() {
    for (const Log& log : logs_) write_log(log);
    commit_text(fs::path(request_.out) / kIndex, index().dump(1, ' ', false, Report::error_handler_t::replace) + "\n");
    return report_;
  }

 private:
  void write_log(const Log& log) {
    const ActorMasks masks = masks_of(log, request_);
    ObjectFinder finder(log.scene, masks, request_.filters);
    const CropReport before = report_;
    for (const std::size_t index : log.frames) {
      listener_.check_stop([&] { return stopped(); });
      std::vector<std::string> warnings;
      guarded(request_.how.skip_bad, warnings, "image left out", [&] { write_frame(log, index, finder); });
      for (const std::string& warning : warnings) listener_.warn(warning);
      tell(log, log.scene.frames[index]);
    }
    const std::size_t images = report_.images - before.images, files = report_.mask_files - before.mask_files;
    if (files < images)
      listener_.warn(text(log.name, ": ", images - files, " of ", images,
                          " images have no mask file; box outlines are used, so their crops show background"));
  }

  void write_frame(const Log& log, std::size_t index, ObjectFinder& finder) {
    Scene single = {};
    single.root = log.scene.root;
    single.cameras = log.scene.cameras;
    single.frames = {log.scene.frames[index]};
    Pixels pixels = load_images(single, single.frames[0].split, {1, false, MaskMeaning::transparent});
    FramePixels& photo = pixels.frames.at(0);
    photo.frame = index;
    const Camera& camera = pixels.cameras.at(0);
    const ObjectsInImage found = finder.objects(photo, camera);
    ++report_.images;
    report_.mask_files += found.mask_file;
    report_.other += found.other;
    for (const ObjectView& object : found.objects) {
      report_.classes[static_cast<std::size_t>(object.asset_class)].add(object);
      if (object.outcome != ObjectOutcome::kept) continue;
      const std::string name = crop_name(log, log.scene.frames[index], object);
      write_png(fs::path(request_.out) / name,
                resized(cut_out(photo, found.mask, object), request_.size, request_.size));
      crops_.push_back(described(log, index, object, found.mask_file));
      crops_.back()["file"] = name;
      crops_.back()["intrinsics"] = crop_intrinsics(camera, object, request_.size);
    }
  }

  static Report described(const Log& log, std::size_t index, const ObjectView& object, bool mask_file) {
    const Frame& frame = log.scene.frames[index];
    const Actor& actor = log.scene.actors[object.actor];
    Report crop = {{"file", ""}, {"log", log.name}, {"image", frame.image}, {"camera", frame.sensor}};
    crop["step"] = frame.step;
    crop["time"] = frame.timestamp ? Report(*frame.timestamp) : Report();
    crop["actor"] = actor.id;
    crop["class"] = kAssetClasses[object.asset_class];
    crop["label"] = actor.label;
    crop["night"] = log.scene.night;
    crop["box"] = json_of(object.box);
    crop["square"] = json_of(object.square);
    crop["pixels"] = object.pixels;
    crop["mask"] = mask_file ? "file" : "box";
    crop["lidar_inside"] = object.lidar_inside;
    crop["lidar_outside"] = object.lidar_outside;
    crop["covered"] = object.covered;
    crop["size_m"] = {actor.size.x(), actor.size.y(), actor.size.z()};
    crop["box_from_camera"] = rows_of(object.box_from_camera);
    return crop;
  }

  Report index() const {
    Report logs = Report::array();
    for (const Log& log : logs_)
      logs.push_back({{"name", log.name}, {"images", log.frames.size()}, {"night", log.scene.night}});
    Report json = {{"schema_version", 1}, {"size", request_.size}, {"split", request_.split}};
    json["protocol"] = request_.how.protocol.name;
    json["holdout"] = request_.how.holdout;
    json["filters"] = {{"most_outside", request_.filters.most_outside},
                       {"least_pixels", request_.filters.least_pixels},
                       {"training", request_.filters.training},
                       {"most_covered", request_.filters.most_covered}};
    json["logs"] = logs;
    json["counts"] = to_json(report_);
    json["crops"] = crops_;
    return json;
  }

  std::string stopped() const {
    return text(crops_.size(), " crops of ", done_, " of ", all_, " images are complete in ", request_.out,
                ", without ", kIndex);
  }

  void tell(const Log& log, const Frame& frame) {
    ++done_;
    if (done_ % kImagesBetweenTells != 0 && done_ != all_) return;
    listener_.say(text("crops ", done_, "/", all_, " images  ", log.name, "/", frame.sensor, "/", frame.step, "  ",
                       crops_.size(), " crops"));
  }

  const CropRequest& request_;
  const Listener& listener_;
  const std::vector<Log> logs_;
  std::size_t done_ = 0, all_ = 0;  // images
  CropReport report_;
  Report crops_ = Report::array();
};

Report json_of(const OutcomeCounts& counts) {
  return {{"objects", counts.all()},
          {"kept", counts.kept()},
          {"kept_without_lidar", counts.without_lidar},
          {"rejected_lidar_outside", counts.of[1]},
          {"rejected_few_pixels", counts.of[2]},
          {"rejected_covered", counts.of[3]}};
}

OutcomeCounts total_of(const CropReport& report) {
  OutcomeCounts total;
  for (const OutcomeCounts& counts : report.classes) {
    for (std::size_t i = 0; i < kObjectOutcomes; ++i) total.of[i] += counts.of[i];
    total.without_lidar += counts.without_lidar;
  }
  return total;
}

std::string row_of(const std::string& name, const OutcomeCounts& counts) {
  return fmt::format("{:<22}{:>9}{:>9}{:>15}{:>13}{:>10}{:>16}\n", name, counts.all(), counts.kept(), counts.of[1],
                     counts.of[2], counts.of[3], counts.without_lidar);
}

}  // namespace

std::size_t OutcomeCounts::all() const { return std::accumulate(of.begin(), of.end(), std::size_t{0}); }

void OutcomeCounts::add(const ObjectView& object) {
  ++of[static_cast<std::size_t>(object.outcome)];
  without_lidar += object.outcome == ObjectOutcome::kept && !object.has_lidar();
}

Image cut_out(const FramePixels& photo, const ActorMask& mask, const ObjectView& object) {
  const PixelBox& square = object.square;
  const int side = square.width();
  Image crop{side, side, 4, std::vector<std::uint8_t>(std::size_t{4} * side * side)};
  for (int row = std::max(0, -square.top); row < std::min(side, photo.height - square.top); ++row)
    for (int column = std::max(0, -square.left); column < std::min(side, photo.width - square.left); ++column) {
      const std::size_t from = std::size_t(square.top + row) * photo.width + (square.left + column);
      if (mask.actors[from] != 1 + static_cast<int>(object.actor)) continue;
      std::copy_n(&photo.rgba[4 * from], 4, &crop.pixels[4 * (std::size_t(row) * side + column)]);
    }
  return crop;
}

CropReport write_crops(const CropRequest& request, const Listener& listener) {
  check_new_folder(request.out);
  std::vector<Log> logs = read_logs(request, listener);
  for (const Log& log : logs) masks_of(log, request);  // before anything is written
  const CropReport report = CropWriter(request, listener, std::move(logs)).write();
  if (total_of(report).kept() == 0) listener.warn("no object passes the filters: there is not one crop");
  return report;
}

Report to_json(const CropReport& report) {
  Report json = {{"images", report.images}, {"images_with_mask_file", report.mask_files}};
  json.update(json_of(total_of(report)));
  json["left_out_other_classes"] = report.other;
  for (int i = 0; i < kAssetClassCount - 1; ++i)
    json["classes"][kAssetClasses[i]] = json_of(report.classes[static_cast<std::size_t>(i)]);
  return json;
}

std::string table_of(const CropReport& report, const ObjectFilters& filters) {
  std::string out = fmt::format("{:<22}{:>9}{:>9}{:>15}{:>13}{:>10}{:>16}\n", "class", "objects", "kept",
                                "LiDAR outside", "few pixels", "covered", "kept, no LiDAR");
  for (std::size_t i = 0; i + 1 < kAssetClassCount; ++i)
    if (report.classes[i].all() > 0) out += row_of(kAssetClasses[i], report.classes[i]);
  out += row_of("all", total_of(report));
  out += fmt::format("{} images, {} with masks from files; {} objects of other classes left out\n", report.images,
                     report.mask_files, report.other);
  out += fmt::format("rejected: more than {:g} % of the LiDAR points outside of the mask; fewer than {} pixels",
                     100 * filters.most_outside, filters.least_pixels);
  if (filters.training) out += fmt::format("; more than {:g} % covered by nearer boxes", 100 * filters.most_covered);
  return out + "\n";
}

}  // namespace cloam
