// See log_source.h.
#include "models/batches/log_source.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

#include "models/scene/actor_space.h"
#include "models/scene/asset_class.h"
#include "models/scene/camera.h"
#include "runtime/error.h"
#include "runtime/ops.h"

namespace cloam {
namespace {

constexpr size_t kSweepsAStep = 4;
constexpr int64_t kSmallestObject = 4;  // cells a side
constexpr int64_t kObjectGroups = 8;    // of objects for all ranks, one of which a step takes
constexpr double kFarActor = 60;        // metres: patches look no further for actors

Eigen::Vector3d rotate(const Eigen::Matrix4d& pose, const Eigen::Vector3d& v) { return pose.topLeftCorner<3, 3>() * v; }
Eigen::Vector3d move(const Eigen::Matrix4d& pose, const Eigen::Vector3d& p) {
  return (pose * p.homogeneous()).head<3>();
}

/// One of the classes first, then one of its actors: most actors are cars, and rare classes would hardly be drawn.
size_t draw_by_class(const std::vector<const Actor*>& actors, HostRandom& random) {
  std::map<int, std::vector<size_t>> of_class;
  for (size_t i = 0; i < actors.size(); ++i) of_class[asset_class(actors[i]->label)].push_back(i);
  const std::vector<size_t>& drawn =
      std::next(of_class.begin(), static_cast<std::ptrdiff_t>(random.below(of_class.size())))->second;
  return drawn[random.below(drawn.size())];
}

}  // namespace

void RayList::add(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction, float range) {
  const Eigen::Vector3d unit = direction.normalized();
  for (int k = 0; k < 3; ++k) {
    origins.push_back(static_cast<float>(origin[k]));
    directions.push_back(static_cast<float>(unit[k]));
  }
  moments.push_back(static_cast<int32_t>(times.size()) - 1);
  ranges.push_back(range);
  intensities.push_back(0);
}

void RayList::last_is_at(double time, std::size_t first) {
  const auto found = std::find(times.begin() + static_cast<std::ptrdiff_t>(first), times.end(), time);
  moments.back() = static_cast<int32_t>(found - times.begin());
  if (found == times.end()) times.push_back(time);
}

RayList part_of(const RayList& rays, int64_t begin, int64_t end) {
  RayList out;
  out.actors = rays.actors;
  out.origins.assign(rays.origins.begin() + 3 * begin, rays.origins.begin() + 3 * end);
  out.directions.assign(rays.directions.begin() + 3 * begin, rays.directions.begin() + 3 * end);
  out.intensities.assign(rays.intensities.begin() + begin, rays.intensities.begin() + end);
  out.moments.assign(rays.moments.begin() + begin, rays.moments.begin() + end);
  if (begin < end) {
    const auto [first, last] = std::minmax_element(out.moments.begin(), out.moments.end());
    const int32_t skipped = *first;
    out.times.assign(rays.times.begin() + skipped, rays.times.begin() + *last + 1);
    for (int32_t& moment : out.moments) moment -= skipped;
  }
  out.ranges.assign(rays.ranges.begin() + begin, rays.ranges.begin() + end);
  return out;
}

Region cells_of(const Camera& camera, int scale) {
  return {0, 0, (camera.width + scale - 1) / scale, (camera.height + scale - 1) / scale};
}

void add_cells(RayList& rays, const Exposing& photo, const Region& region, int scale) {
  const auto& [camera, middle, time, motion] = photo;
  Eigen::Matrix4d pose = middle;
  if (motion.shutter == 0) rays.times.push_back(time);
  for (int64_t y = region.y; y < region.y + region.rows; ++y) {
    const double row = (static_cast<double>(y) + 0.5) * scale;
    if (motion.shutter != 0) {
      const double seconds = motion.seconds_after(row, camera.height);
      rays.times.push_back(time + seconds);
      pose = middle * motion.moved(seconds);
    }
    for (int64_t x = region.x; x < region.x + region.columns; ++x)
      rays.add(pose.block<3, 1>(0, 3), rotate(pose, direction(camera, {(static_cast<double>(x) + 0.5) * scale, row})));
  }
}

Tensor Photographed::kept(const Tensor& render) const { return used ? render * used : render; }

/// What regions of photos of one size show.
struct LogSource::HostPixels {
  int64_t count, height, width;
  std::vector<float> truth, used, silhouette;
  std::vector<PhotoOf> of;

  HostPixels(int64_t n, int64_t h, int64_t w, bool masked)
      : count(n), height(h), width(w), truth(static_cast<size_t>(3 * n * h * w)) {
    if (masked) used.assign(truth.size() / 3, 1.f);
  }
  Photographed tensors() const {
    Photographed out{from_host(truth, {count, 3, height, width}), {}, 1};
    out.of = of;
    if (!silhouette.empty()) out.silhouette = from_host(silhouette, {static_cast<int64_t>(silhouette.size())});
    if (used.empty()) return out;
    out.used = from_host(used, {count, 1, height, width});
    out.share = std::accumulate(used.begin(), used.end(), 0.f) / static_cast<float>(used.size());
    return out;
  }
};

namespace {

std::vector<LidarPoints> points_of(std::vector<LoadedSweep>& sweeps) {
  std::vector<LidarPoints> points;
  for (LoadedSweep& sweep : sweeps) points.push_back(std::move(sweep.points));
  return points;
}

}  // namespace

LogSweeps::LogSweeps(std::vector<LoadedSweep> sweeps) : points_(std::vector<LidarPoints>{}) {
  for (size_t i = 0; i < sweeps.size(); ++i)
    if (sweeps[i].points.size() > 0) kept_.push_back({*sweeps[i].sweep, sweeps[i].points.size(), i});
  points_ = points_of(sweeps);
}

LogSweeps::LogSweeps(const std::vector<Sweep>& sweeps, const std::vector<size_t>& counts, Stored<LidarPoints> points)
    : points_(std::move(points)) {
  for (size_t i = 0; i < sweeps.size(); ++i)
    if (counts[i] > 0) kept_.push_back({sweeps[i], counts[i], i});
  kept_.shrink_to_fit();
}

LogSource::LogSource(RestingScene scene, PhotoStore photos, LogSweeps sweeps, const LogRays& axes)
    : scene_(std::move(scene)),
      photos_(std::move(photos)),
      sweeps_(std::move(sweeps)),
      log_from_world_(axes.log_from_world),
      scale_(axes.scale),
      silhouettes_(axes.silhouettes),
      rolling_(axes.rolling) {
  if (photos_.size() == 0)
    throw Error(Fault::data, text(scene_.get()->root.string(), ": no image of this log is in the training split"));
}

int64_t LogSource::patch_side(int64_t wanted) const {
  for (const Camera& camera : photos_.listed().cameras)
    wanted = std::min<int64_t>(wanted, std::min(camera.width, camera.height) / scale_);
  if (wanted < 1) throw Error(Fault::data, text("images are smaller than the ", scale_, " pixels that a ray covers"));
  return wanted;
}

LogSource::Corner LogSource::random_corner(const FramePixels& photo, HostRandom& random, int64_t side) const {
  const auto columns = static_cast<size_t>(photo.width / scale_ - side + 1),
             rows = static_cast<size_t>(photo.height / scale_ - side + 1);
  return {static_cast<int64_t>(random.below(columns)), static_cast<int64_t>(random.below(rows))};
}

/// A patch that holds the middle of some actor in sight; a random one where there is none.
LogSource::Corner LogSource::corner_near_actor(const Scene& scene, const FramePixels& photo, HostRandom& random,
                                               int64_t side) const {
  const Frame& frame = scene.frames[photo.frame];
  const Camera& camera = camera_of(photo);
  const Eigen::Matrix4d camera_from_world = frame.world_from_camera.inverse();
  std::vector<const Actor*> actors;
  std::vector<Eigen::Vector2d> middles;
  for (const Actor& actor : scene.actors) {
    const auto pose = world_from_box_at(actor, frame.timestamp.value_or(0));
    if (!pose) continue;
    const Eigen::Vector3d p = move(camera_from_world, pose->block<3, 1>(0, 3));
    if (p.z() < 0.5 || p.z() > kFarActor) continue;
    const Eigen::Vector2d at = project(camera, p);
    if (at.x() < 0 || at.y() < 0 || at.x() >= photo.width || at.y() >= photo.height) continue;
    actors.push_back(&actor);
    middles.push_back(at);
  }
  if (middles.empty()) return random_corner(photo, random, side);
  const Eigen::Vector2d middle = middles[draw_by_class(actors, random)] / scale_;
  const auto around = [&](double centre, int64_t size) {
    const auto shift = static_cast<int64_t>(static_cast<double>(random.uniform()) * static_cast<double>(side));
    return std::clamp<int64_t>(static_cast<int64_t>(centre) - shift, 0, size - side);
  };
  return {around(middle.x(), photo.width / scale_), around(middle.y(), photo.height / scale_)};
}

/// Bounds of the corners that lie in front of the camera, in cells.
struct LogSource::Span {
  Eigen::Vector2d low, high;
  bool behind;  // some corner lies behind the camera
};

std::optional<LogSource::Span> LogSource::span_of(const Actor& actor, const Frame& frame, const Camera& camera,
                                                  const Eigen::Vector3d& stretch) const {
  const auto pose = world_from_box_at(actor, frame.timestamp.value_or(0));
  if (!pose) return {};
  const Eigen::Matrix4d camera_from_box = frame.world_from_camera.inverse() * *pose;
  Span span{{1e9, 1e9}, {-1e9, -1e9}, false};
  for (int k = 0; k < 8; ++k) {
    const Eigen::Vector3d sign(k & 1 ? 0.5 : -0.5, k & 2 ? 0.5 : -0.5, k & 4 ? 0.5 : -0.5);
    const Eigen::Vector3d p = move(camera_from_box, sign.cwiseProduct(stretch).cwiseProduct(actor.size));
    span.behind = span.behind || p.z() < 0.1;
    if (p.z() < 0.1) continue;
    const Eigen::Vector2d at = project(camera, p) / scale_;
    span.low = span.low.cwiseMin(at);
    span.high = span.high.cwiseMax(at);
  }
  if (span.low.x() > span.high.x()) return {};
  return span;
}

/// Those whose boxes, twice as wide and long for their shadows, have a corner region that meets the patch.
void LogSource::mark_actors(const Scene& scene, RayList& rays, const Drawn& part) const {
  const FramePixels& photo = listed(part.place);
  const Region& region = part.region;
  for (size_t a = 0; a < scene.actors.size(); ++a) {
    if (rays.actors[a]) continue;
    const auto span = span_of(scene.actors[a], scene.frames[photo.frame], camera_of(photo), {2, 2, 1.2});
    if (!span) continue;
    const auto meets = [&](int axis, int64_t begin, int64_t size) {
      return span->low[axis] < static_cast<double>(begin + size) && span->high[axis] > static_cast<double>(begin);
    };
    rays.actors[a] = span->behind || (meets(0, region.x, region.columns) && meets(1, region.y, region.rows));
  }
}

/// Of actors that are near and wholly in front of the camera, in the order drawn.
std::vector<Region> LogSource::object_regions(const Scene& scene, const FramePixels& photo, HostRandom& random,
                                              const ObjectPatches& objects) const {
  std::vector<const Actor*> actors;
  std::vector<Region> all, drawn;
  for (const Actor& actor : scene.actors) {
    const auto span = span_of(actor, scene.frames[photo.frame], camera_of(photo), {1, 1, 1});
    if (!span || span->behind) continue;
    const auto begin = [&](int axis) {
      return std::max<int64_t>(0, static_cast<int64_t>(std::floor(span->low[axis])));
    };
    const auto end = [&](int axis, int size) {
      return std::min<int64_t>(size / scale_, static_cast<int64_t>(std::ceil(span->high[axis])));
    };
    const Region region = {begin(0), begin(1), end(0, photo.width) - begin(0), end(1, photo.height) - begin(1)};
    if (region.columns < kSmallestObject || region.rows < kSmallestObject) continue;
    actors.push_back(&actor);
    all.push_back(region);
  }
  const auto shorten = [&](int64_t& from, int64_t& size) {
    const int64_t kept = std::min(size, objects.longest);
    from += static_cast<int64_t>(random.below(static_cast<size_t>(size - kept + 1)));
    size = kept;
  };
  while (!all.empty() && static_cast<int>(drawn.size()) < objects.count) {
    const auto at = static_cast<std::ptrdiff_t>(draw_by_class(actors, random));
    drawn.push_back(all[static_cast<size_t>(at)]);
    all.erase(all.begin() + at);
    actors.erase(actors.begin() + at);
    shorten(drawn.back().x, drawn.back().columns);
    shorten(drawn.back().y, drawn.back().rows);
  }
  return drawn;
}

void LogSource::add_silhouette(const Drawn& part, HostPixels& pixels) const {
  const Silhouette& cells = silhouettes_[part.place];
  const Region& region = part.region;
  const int64_t columns = listed(part.place).width / scale_;
  for (int64_t y = region.y; y < region.y + region.rows; ++y)
    for (int64_t x = region.x; x < region.x + region.columns; ++x)
      pixels.silhouette.push_back(cells.empty() ? -1.f : cells[static_cast<size_t>(y * columns + x)]);
}

void LogSource::add_region(const Scene& scene, RayList& rays, const Drawn& part, HostPixels& pixels,
                           int64_t place) const {
  const std::shared_ptr<const FramePixels> read = photos_[part.place];
  const FramePixels& photo = *read;
  const Region& region = part.region;
  const Frame& frame = scene.frames[photo.frame];
  const double time = frame.timestamp.value_or(0);
  const CameraMotion motion = rolling_ ? camera_motion(scene, frame.sensor, time) : CameraMotion();
  add_cells(rays, {camera_of(photo), log_from_world_ * frame.world_from_camera, time, motion}, region, scale_);
  pixels.of.push_back({photo.frame, camera_of(photo).fx});
  if (!silhouettes_.empty()) add_silhouette(part, pixels);
  for (int64_t y = 0; y < pixels.height; ++y)
    for (int64_t x = 0; x < pixels.width; ++x) {
      const auto from = static_cast<size_t>((region.y * scale_ + y) * photo.width + region.x * scale_ + x);
      if (!photo.mask.empty() && photo.mask[from] == 0) {
        pixels.used[static_cast<size_t>((place * pixels.height + y) * pixels.width + x)] = 0;
        continue;
      }
      for (int64_t c = 0; c < 3; ++c)
        pixels.truth[static_cast<size_t>(((3 * place + c) * pixels.height + y) * pixels.width + x)] =
            static_cast<float>(photo.rgba[4 * from + static_cast<size_t>(c)]) / 255.f;
    }
}

std::vector<LogSource::Drawn> LogSource::draw_patches(const Scene& scene, HostRandom& random, int64_t count,
                                                      int64_t side) const {
  std::vector<Drawn> parts;
  for (int64_t n = 0; n < count; ++n) {
    const size_t place = random.below(photos_.size());
    const FramePixels& photo = listed(place);
    const Corner corner =
        n % 2 == 1 ? corner_near_actor(scene, photo, random, side) : random_corner(photo, random, side);
    parts.push_back({place, {corner.x, corner.y, side, side}});
  }
  return parts;
}

Photographed LogSource::add_patches(RayList& rays, HostRandom& random, int64_t count, int64_t side,
                                    const Share& share) const {
  const std::shared_ptr<const Scene> scene = scene_.get();
  HostPixels pixels(share.size(count), side * scale_, side * scale_, photos_.planes().masks);
  rays.actors.assign(scene->actors.size(), false);
  const std::vector<Drawn> parts = draw_patches(*scene, random, count, side);
  for (const Drawn& part : parts) mark_actors(*scene, rays, part);
  for (int64_t n = share.begin(count); n < share.end(count); ++n)
    add_region(*scene, rays, parts[static_cast<size_t>(n)], pixels, n - share.begin(count));
  return pixels.tensors();
}

void LogSource::expect_patches(StepAhead& ahead, int64_t count, int64_t side) const {
  const std::vector<Drawn> parts = draw_patches(*scene_.get(), ahead.random, count, side);
  for (int64_t n = ahead.share.begin(count); n < ahead.share.end(count); ++n)
    photos_.want(parts[static_cast<size_t>(n)].place, ahead.step);
}

/// An object's patch has from some cells to thousands, and ranks wait for the one with the largest. So each step draws
/// many, sorted by size, and one group of them with as many as there are ranks: alike in size, and each object as
/// likely as if it were drawn alone.
std::vector<std::optional<LogSource::Drawn>> LogSource::draw_objects(const Scene& scene, HostRandom& random,
                                                                     const ObjectPatches& objects,
                                                                     const Share& share) const {
  std::vector<std::optional<Drawn>> parts;
  const int64_t groups = share.ranks > 1 ? kObjectGroups : 1;
  for (int64_t i = 0; i < groups * share.ranks; ++i) {
    const size_t place = random.below(photos_.size());
    const std::vector<Region> regions = object_regions(scene, listed(place), random, {1, objects.longest});
    const bool none = regions.empty() || objects.count == 0;
    parts.push_back(none ? std::nullopt : std::optional(Drawn{place, regions.front()}));
  }
  if (groups == 1) return parts;
  const auto cells = [](const std::optional<Drawn>& part) {
    return part ? part->region.rows * part->region.columns : 0;
  };
  std::stable_sort(parts.begin(), parts.end(), [&](const auto& a, const auto& b) { return cells(a) < cells(b); });
  const auto first = parts.begin() + static_cast<std::ptrdiff_t>(random.below(groups)) * share.ranks;
  return {first, first + share.ranks};
}

Photographed LogSource::add_object(RayList& rays, HostRandom& random, const ObjectPatches& objects,
                                   const Share& share) const {
  const std::shared_ptr<const Scene> scene = scene_.get();
  const std::vector<std::optional<Drawn>> parts = draw_objects(*scene, random, objects, share);
  for (const std::optional<Drawn>& part : parts)
    if (part) mark_actors(*scene, rays, *part);
  const std::optional<Drawn>& own = parts[static_cast<size_t>(share.rank)];
  if (!own) return {};
  HostPixels pixels(1, own->region.rows * scale_, own->region.columns * scale_, photos_.planes().masks);
  add_region(*scene, rays, *own, pixels, 0);
  return pixels.tensors();
}

void LogSource::expect_object(StepAhead& ahead, const ObjectPatches& objects) const {
  const std::vector<std::optional<Drawn>> parts = draw_objects(*scene_.get(), ahead.random, objects, ahead.share);
  const std::optional<Drawn>& own = parts[static_cast<size_t>(ahead.share.rank)];
  if (own) photos_.want(own->place, ahead.step);
}

size_t LogSource::draw_image(HostRandom& random, const Share& share) const {
  std::vector<size_t> of_ranks;
  for (int64_t rank = 0; rank < share.ranks; ++rank) of_ranks.push_back(random.below(photos_.size()));
  return of_ranks[static_cast<size_t>(share.rank)];
}

Photographed LogSource::add_image(RayList& rays, HostRandom& random, const ObjectPatches& objects,
                                  const Share& share) const {
  (void)patch_side(1);  // an image of no cell is an error
  const std::shared_ptr<const Scene> scene = scene_.get();
  const size_t place = draw_image(random, share);
  const FramePixels& photo = listed(place);
  const Drawn all = {place, {0, 0, photo.width / scale_, photo.height / scale_}};
  HostPixels pixels(1, all.region.rows * scale_, all.region.columns * scale_, photos_.planes().masks);
  rays.actors.assign(scene->actors.size(), false);
  mark_actors(*scene, rays, all);
  add_region(*scene, rays, all, pixels, 0);
  Photographed out = pixels.tensors();
  // Numbers of its own: how many are drawn depends on the image, and ranks see different ones.
  HostRandom own(random.below(size_t{1} << 32), static_cast<uint64_t>(share.rank));
  out.objects = object_regions(*scene, photo, own, objects);
  return out;
}

void LogSource::expect_image(StepAhead& ahead) const {
  photos_.want(draw_image(ahead.random, ahead.share), ahead.step);
  (void)ahead.random.next();  // the seed of its objects
}

void LogSource::add_returns(RayList& rays, HostRandom& random, int64_t count, const Share& share) const {
  const std::shared_ptr<const Scene> scene = scene_.get();
  const auto parts = static_cast<int64_t>(std::min(kSweepsAStep, sweeps_.size()));
  for (int64_t part = 0; part < parts; ++part) {
    const size_t place = random.below(sweeps_.size());
    const Sweep& sweep = sweeps_.sweep(place);
    const std::shared_ptr<const LidarPoints> points = sweeps_.points(place);
    const size_t first = rays.times.size();
    rays.times.push_back(sweep.timestamp);
    ActorSpaces others(*scene, rays.actors);
    for (int64_t i = part; i < count; i += parts) {
      const size_t at = random.below(points->size());
      const float* p = &points->positions[3 * at];
      if (!share.holds(i, count)) continue;
      const SeenFrom from = seen_from(sweep, *points, at);
      const Eigen::Vector3d world(p[0], p[1], p[2]), lidar = move(log_from_world_, from.origin),
                                                     way = move(log_from_world_, world) - lidar;
      if (!rays.actors.empty() && others.at(from.time).holds(world)) continue;
      rays.add(lidar, way.norm() > 1e-3 ? way : Eigen::Vector3d::UnitX(), static_cast<float>(way.norm()));
      rays.intensities.back() = points->intensities[at];
      rays.last_is_at(from.time, first);
    }
  }
}

void LogSource::expect_returns(StepAhead& ahead, int64_t count) const {
  const auto parts = static_cast<int64_t>(std::min(kSweepsAStep, sweeps_.size()));
  for (int64_t part = 0; part < parts; ++part) {
    sweeps_.want(ahead.random.below(sweeps_.size()), ahead.step);
    for (int64_t i = part; i < count; i += parts) (void)ahead.random.next();  // which return
  }
}

}  // namespace cloam
