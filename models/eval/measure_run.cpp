// See measure_run.h.
#include "models/eval/measure_run.h"

#include <algorithm>
#include <chrono>
#include <optional>

#include "models/data/turned_log.h"
#include "models/eval/image_sets.h"
#include "models/eval/pictures.h"
#include "models/io/image.h"
#include "models/metrics/feature_distance.h"
#include "models/runs/shared_work.h"
#include "models/train/renders_views.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;
using Report = nlohmann::ordered_json;

struct Evaluator {
  const Listener& listener;
  const Ranks& ranks;
  fs::path pictures;
  std::optional<FeatureNetwork> network = {};
  std::optional<Lpips> lpips = {};
  bool as_sets = false;                        // rotate360: renders and source images are compared as sets, too
  Eigen::MatrixXd rendered = {}, source = {};  // their features, a row an image; actors alone
  std::size_t done = 0;                        // photos, but for those of now
  Eigen::Index as_recorded = 0;                // of `rendered`, the first rows: those at 0 degrees

  void show(const EvaluatedImage& image, std::size_t number, const std::string& name) const {
    const int w = image.frame.width, h = image.frame.height;
    const auto& rgb = image.picture.rgb;
    write_png(
        pictures / (name + ".png"),
        contact_sheet({to_image(rgb, w, h), to_image(image.truth, w, h), error_image(rgb, image.truth, w, h)}, 3));
    listener.say(text("eval ", number, "  ", name));
  }

  /// For add_row; nothing of an image that is too small for the network.
  Report features_of(const std::vector<float>& rgb, const ActorMask& actors) const {
    std::vector<double> row;
    if (network && std::min(actors.width, actors.height) >= network->smallest) {
      const Eigen::MatrixXd features =
          pooled_features(*network, as_batch(on_black(rgb, actors.any()), actors.width, actors.height));
      row.assign(features.data(), features.data() + features.size());
    }
    return packed(row);
  }
  static void add_row(Eigen::MatrixXd& rows, const Report& features) {
    const std::vector<double> row = unpacked<double>(features);
    if (row.empty()) return;
    const auto width = static_cast<Eigen::Index>(row.size());
    rows.conservativeResize(rows.rows() + 1, width);
    rows.bottomRows(1) = Eigen::Map<const Eigen::RowVectorXd>(row.data(), width);
  }

  /// Shared among ranks: `make` of each photo.
  std::vector<Report> share_photos(std::size_t count, const std::function<Report(std::size_t)>& make) const {
    const auto complete = [&](std::size_t now) {
      return text(done + now, " pictures are complete in ", pictures.string(), "; no metrics were written");
    };
    return share_out(ranks, listener, {count, make, complete});
  }

  /// Measures photos and writes a picture of each under its name. compare: as EvaluateOptions has it.
  std::vector<ImageScore> measure(Method& method, const MeasuredScene& scene, const std::vector<std::string>& names,
                                  bool compare) {
    const auto make = [&](std::size_t item) {
      Report features = packed(std::vector<double>());
      EvaluateOptions options{compare, network ? &*network : nullptr, lpips ? &*lpips : nullptr};
      options.seen = [&](const EvaluatedImage& image) {
        if (as_sets) features = features_of(image.picture.rgb, *image.actors);
        show(image, done + item + 1, names[item]);
      };
      const ImageScore score = evaluate_photo(*as<RendersViews>(method), scene, item, options);
      return Report::array({packed(std::vector<ImageFigures>{score}), features, packed(score.actors)});
    };
    std::vector<ImageScore> scores;
    for (const Report& made : share_photos(names.size(), make)) {
      const FramePixels& photo = scene.photos.frames[scores.size()];
      scores.push_back({unpacked<ImageFigures>(made.at(0)).front(),
                        scene.scene.frames[photo.frame].image,
                        {},
                        unpacked<ActorFigures>(made.at(2))});
      add_row(rendered, made.at(1));
    }
    done += scores.size();
    return scores;
  }
};

std::vector<std::string> names_of(const Photos& photos, const Scene& scene, const Pixels& pixels, bool several) {
  std::vector<std::size_t> frames;
  for (const FramePixels& frame : pixels.frames) frames.push_back(frame.frame);
  std::vector<std::string> names = file_names(scene, frames);
  for (std::string& name : names) name = (several ? photos.name + "_" : "") + name;
  return names;
}

void note_kind(const Photos& photos, EvalResult& result) {
  result.protocol = photos.protocol;
  result.is_log |= photos.scene.is_log;
  for (const FramePixels& frame : photos.measured.frames) result.has_masks |= !frame.mask.empty();
}

/// How many photos have exact masks of actors.
std::size_t with_truth(const ActorMasks& masks, const Scene& scene, const Pixels& photos) {
  return static_cast<std::size_t>(
      std::count_if(photos.frames.begin(), photos.frames.end(),
                    [&](const FramePixels& photo) { return masks.has_truth(scene.frames[photo.frame]); }));
}

/// Of a log. Masks of training photos may be damaged without harm to what is measured.
TrainingViews training_views(const Photos& photos, const Listener& listener) {
  try {
    return {photos.train_scene, photos.train};
  } catch (const Error& error) {
    if (error.fault() != Fault::data) throw;
    listener.warn(text("no view_degrees in per_actor.csv: ", error.what()));
    return {};
  }
}

void measure_scene(Method& method, const Photos& photos, bool several, Evaluator& evaluator, EvalResult& result) {
  note_kind(photos, result);
  SceneResult scene{photos.name, {}, {}, 0};
  const Baselines baselines(photos.train_scene, photos.train);
  std::optional<ActorMasks> masks;
  TrainingViews views;
  if (photos.scene.is_log) {
    masks.emplace(photos.scene);
    views = training_views(photos, evaluator.listener);
    scene.actors = measured_actors(photos.scene);
  }
  if (masks) scene.truth_masks = with_truth(*masks, photos.scene, photos.measured);
  scene.images = evaluator.measure(
      method, {photos.index, photos.scene, photos.measured, baselines, masks ? &*masks : nullptr, &views},
      names_of(photos, photos.scene, photos.measured, several), true);
  if (scene.truth_masks > 0 && scene.truth_masks < scene.images.size())
    evaluator.listener.warn(text(photos.name, ": ", scene.truth_masks, " of ", scene.images.size(),
                                 " images have actor masks in truth/; box outlines are used for the others"));
  // Always the run's own held-out sweeps: what it was trained on is no measure, whatever the protocol.
  if (auto* street = as<Street>(method))
    scene.lidar = lidar_scores(*street, photos.train_scene, photos.index, evaluator.ranks, evaluator.listener);
  result.scenes.push_back(std::move(scene));
}

/// The actors as the log itself shows them, which turned ones are compared with.
void add_source(const Photos& photos, Evaluator& evaluator) {
  const ActorMasks masks(photos.scene);
  std::vector<const FramePixels*> front;
  for (const FramePixels& pixels : photos.train.frames)
    if (photos.train_scene.frames[pixels.frame].sensor == front_sensor(photos.scene)) front.push_back(&pixels);
  const auto make = [&](std::size_t item) {
    const FramePixels& pixels = *front[item];
    const Camera& camera = photos.train.cameras[static_cast<std::size_t>(pixels.camera)];
    return evaluator.features_of(on_white(pixels), masks.of(photos.train_scene.frames[pixels.frame], camera));
  };
  for (const Report& made : evaluator.share_photos(front.size(), make)) Evaluator::add_row(evaluator.source, made);
}

/// Of a run on one image: that moment alone, and of the actors those that the image shows.
void keep_image(TurnedLog& turned, const Photos& photos) {
  if (photos.image.empty()) return;
  const std::size_t shown = frame_named(photos.scene, photos.image);
  const Frame& frame = photos.scene.frames[shown];
  if (frame.sensor != front_sensor(photos.scene))
    throw Error(Fault::usage, text("rotate360 measures images of ", front_sensor(photos.scene),
                                   ", but the run was trained on ", photos.image, " alone"));
  for (std::size_t i = 0; i < turned.scene.frames.size(); ++i)
    if (i != shown) turned.scene.frames[i].split = Split::unused;
  const ActorMask mask = ActorMasks(photos.scene).of(frame, photos.train.cameras.front());
  for (std::size_t a = 0; a < turned.scene.actors.size(); ++a)
    if (std::count(mask.actors.begin(), mask.actors.end(), static_cast<int>(a) + 1) < kShownPixels)
      turned.scene.actors[a].boxes.clear();
}

/// One log with its actors turned by one angle, into the log's result.
void measure_turned(const RestoredRun& run, const Photos& photos, const TurnedLog& turned, const TrainingViews& views,
                    Evaluator& evaluator, SceneResult& result) {
  Pixels pixels = load_images(turned.scene, Split::test, photos.options);
  take_learned_lenses(run, turned.scene, photos.index, pixels);
  const Baselines baselines(photos.train_scene, photos.train);
  const ActorMasks masks(turned.scene, turned.has_truth);
  std::vector<std::string> names = names_of(photos, turned.scene, pixels, true);
  for (std::string& name : names) name = text("rot", turned.degrees, "_", name);
  result.truth_masks += with_truth(masks, turned.scene, pixels);
  auto images = evaluator.measure(*run.method, {photos.index, turned.scene, pixels, baselines, &masks, &views}, names,
                                  turned.has_truth);
  for (ImageScore& image : images) image.degrees = turned.degrees;
  result.images.insert(result.images.end(), images.begin(), images.end());
}

/// Fault::data where nothing was measured, because of `why`.
void require_images(const EvalResult& result, const std::string& why) {
  for (const SceneResult& scene : result.scenes)
    if (!scene.images.empty()) return;
  throw Error(Fault::data, "there is no image to evaluate: " + why);
}

void measure_rotations(const EvalRequest& request, const RestoredRun& trained, Evaluator& evaluator,
                       EvalResult& result) {
  const std::vector<std::size_t> scenes = scenes_to_measure(trained, request);
  result.scenes.resize(scenes.size());
  evaluator.as_sets = true;
  std::vector<std::size_t> possible(scenes.size());  // images, if there were truth for all
  std::vector<TrainingViews> views(scenes.size());
  for (int degrees = 0; degrees < kFullTurn; degrees += kTurnStep) {
    const RestoredRun run = restore_run(request.run, [&](Scenes& all) {
      for (Scene& scene : all) turn_actors(scene, degrees);
    });
    for (std::size_t i = 0; i < scenes.size(); ++i) {
      const Photos photos = photos_of(trained, request, scenes[i], evaluator.listener);
      note_kind(photos, result);
      result.scenes[i].name = photos.name;
      result.scenes[i].actors = measured_actors(photos.scene);
      if (degrees == 0) {
        add_source(photos, evaluator);
        views[i] = training_views(photos, evaluator.listener);
      }
      TurnedLog turned = turned_log(photos.scene, degrees);
      if (turned.has_truth && photos.image.empty()) possible[i] += turned.possible;
      keep_image(turned, photos);
      if (!turned.has_truth && degrees == 0)
        evaluator.listener.warn(
            photos.name + ": truth/ has no images of turned actors: renders are shown beside the original images");
      if (frames_of(turned.scene, Split::test).empty()) continue;
      measure_turned(run, photos, turned, views[i], evaluator, result.scenes[i]);
    }
    if (degrees == 0) evaluator.as_recorded = evaluator.rendered.rows();
  }
  for (std::size_t i = 0; i < scenes.size(); ++i) {
    const SceneResult& scene = result.scenes[i];
    if (scene.images.size() < possible[i])
      evaluator.listener.warn(text(scene.name, ": truth/ has ", scene.images.size(), " of ", possible[i],
                                   " images of turned actors; only those are measured"));
  }
  require_images(result, "a turned actor encloses the camera at every angle, or truth/ has no image of this time");
  if (evaluator.rendered.rows() < 2 || evaluator.source.rows() < 2) return;
  result.sets = set_distances(evaluator.rendered, evaluator.source);
  const Eigen::Index turned = evaluator.rendered.rows() - evaluator.as_recorded;
  if (turned >= 2) result.sets_without_0 = set_distances(evaluator.rendered.bottomRows(turned), evaluator.source);
  warn_of_few_images(*result.sets, evaluator.listener);
}

void measure_photos(const EvalRequest& request, const RestoredRun& run, Evaluator& evaluator, EvalResult& result) {
  const std::vector<std::size_t> scenes = scenes_to_measure(run, request);
  for (const std::size_t scene : scenes)
    measure_scene(*run.method, photos_of(run, request, scene, evaluator.listener), scenes.size() > 1, evaluator,
                  result);
  require_images(result, text("the protocol ", result.protocol, " selects none; novel needs a ", kFrontLeftSensor));
}

}  // namespace

fs::path pictures_of(const EvalRequest& request) {
  return request.images.empty() ? RunPaths{request.run}.eval() / "images" : fs::path(request.images);
}

EvalResult measure_run(EvalRequest request, RestoredRun& run, const Listener& listener, const Ranks& ranks) {
  const auto start = std::chrono::steady_clock::now();
  take_own_data(run, request, listener);
  if (request.downscale) run.record.reading.downscale = *request.downscale;
  Evaluator evaluator{listener, ranks, pictures_of(request)};
  EvalResult result;
  const RunRecord& record = run.record;
  result.train_protocol = record.reading.protocol.name;
  result.method = record.method;
  result.preset = record.preset;
  result.step = run.progress.step;
  result.downscale = record.reading.downscale;
  if (!request.features.empty()) {
    evaluator.network = features_named(request.features);
    result.features = evaluator.network->name;
  }
  if (!request.lpips.empty()) {
    evaluator.lpips = lpips_named(request.lpips);
    result.perceptual = evaluator.lpips->name;
  }
  if (protocol_of(run, request) == "rotate360" && request.other.empty())
    measure_rotations(request, run, evaluator, result);
  else
    measure_photos(request, run, evaluator, result);
  result.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  if (ranks.rank() == 0) write_reports(RunPaths{request.run}.eval(), result);
  return result;
}

}  // namespace cloam
