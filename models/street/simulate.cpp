// See simulate.h.
#include "models/street/simulate.h"

#include <Eigen/Dense>
#include <algorithm>
#include <limits>
#include <map>
#include <optional>

#include "models/scene/edit.h"

namespace cloam {
namespace {

using Eigen::Vector3d;

constexpr double kMargin = 0.2;    // metres: boxes are drawn tightly, and moving things smear
constexpr double kSurface = 0.05;  // metres: how far an actor's surface may be outside its box
constexpr double kBeyond = 1e-3;   // metres behind a box where a ray goes on
constexpr float kMissing = 0.5f;   // how likely a ray is missing that is
constexpr int kMaxBoxes = 4;       // that one ray goes through before it is given up

struct Span {
  double enter = 0, leave = 0;  // along the ray, of unit speed
  bool below = false;           // whether it leaves through the bottom
};

class Box {
 public:
  Box(const Eigen::Matrix4d& world_from_box, const Vector3d& size)
      : box_from_world_(world_from_box.inverse()), half_(0.5 * size) {}

  bool contains(const Vector3d& point, double margin) const {
    const Vector3d p = box_from_world_.topLeftCorner<3, 3>() * point + box_from_world_.topRightCorner<3, 1>();
    return (p.cwiseAbs() - half_).maxCoeff() <= margin;
  }

  /// The part of a ray (from its origin on) that lies in the box, by its three pairs of planes.
  std::optional<Span> span(const Vector3d& origin, const Vector3d& direction) const {
    const Vector3d o = box_from_world_.topLeftCorner<3, 3>() * origin + box_from_world_.topRightCorner<3, 1>();
    const Vector3d d = box_from_world_.topLeftCorner<3, 3>() * direction;
    Span span{0, std::numeric_limits<double>::infinity(), false};
    for (int axis = 0; axis < 3; ++axis) {
      if (d[axis] == 0) {
        if (std::abs(o[axis]) > half_[axis]) return std::nullopt;
        continue;
      }
      const double a = (-half_[axis] - o[axis]) / d[axis], b = (half_[axis] - o[axis]) / d[axis];
      span.enter = std::max(span.enter, std::min(a, b));
      if (std::max(a, b) >= span.leave) continue;
      span.leave = std::max(a, b);
      span.below = axis == 2 && d[axis] < 0;
    }
    return span.enter < span.leave ? std::optional(span) : std::nullopt;
  }

 private:
  Eigen::Matrix4d box_from_world_;
  Vector3d half_;
};

/// The actors that were edited: as they were, as they are, and how the street's answers name them.
struct Edited {
  std::vector<const Actor*> before, after;
  std::vector<int> numbers;  // 1 + place in the edited scene

  explicit Edited(const EditedLog& log) {
    for (std::size_t i = 0; i < log.edited.actors.size(); ++i) {
      const Actor& now = log.edited.actors[i];
      const auto was = std::find_if(log.recorded.actors.begin(), log.recorded.actors.end(),
                                    [&](const Actor& actor) { return actor.id == now.id; });
      const bool is_known = was != log.recorded.actors.end();
      if (is_known && !differs(*was, now)) continue;
      if (is_known) before.push_back(&*was);
      after.push_back(&now);
      numbers.push_back(static_cast<int>(i) + 1);
    }
  }
  bool has(int number) const { return std::find(numbers.begin(), numbers.end(), number) != numbers.end(); }
};

std::vector<const Actor*> all_of(const Scene& scene) {
  std::vector<const Actor*> actors;
  for (const Actor& actor : scene.actors) actors.push_back(&actor);
  return actors;
}

std::vector<Box> boxes_at(const std::vector<const Actor*>& actors, double time) {
  std::vector<Box> boxes;
  for (const Actor* actor : actors) {
    if (const auto pose = world_from_box_at(*actor, time)) boxes.emplace_back(*pose, actor->size);
  }
  return boxes;
}

/// A recorded return that may change.
struct Beam {
  std::size_t point = 0;
  SeenFrom from = {};
  Vector3d direction = Vector3d::Zero();
  double recorded = 0;                  // depth
  bool freed = false;                   // it lay on an actor that was edited
  double start = 0;                     // where the ray begins that is asked next
  double ground = 0;                    // where it ends if nothing is found from there; 0: nowhere
  double depth = 0;                     // the answer; 0: nothing
  std::optional<float> intensity = {};  // of the answer, of streets that know it
};

class SweepEditor {
 public:
  SweepEditor(Street& street, const EditedLog& log, const Sweep& sweep, const LidarPoints& recorded)
      : street_(street), log_(log), sweep_(sweep), points_(recorded), edited_(log) {}

  SweepEdit run() {
    std::vector<Beam> beams = touched();
    result_.measured = beams.size();
    std::vector<Beam*> open;
    for (Beam& beam : beams) open.push_back(&beam);
    for (int pass = 0; pass < kMaxBoxes && !open.empty(); ++pass) open = ask(open);
    for (Beam* beam : open) beam->depth = 0;
    write(beams);
    return std::move(result_);
  }

 private:
  Vector3d recorded_point(std::size_t i) const {
    return Eigen::Map<const Eigen::Vector3f>(&points_.positions[3 * i]).cast<double>();
  }

  /// Where the edited actors were and are, and where all are, at a time.
  struct Placed {
    std::vector<Box> before, after, present;
  };
  const Placed& moment(double time) {
    const auto [found, fresh] = moments_.try_emplace(time);
    if (fresh)
      found->second = {boxes_at(edited_.before, time), boxes_at(edited_.after, time),
                       boxes_at(all_of(log_.edited), time)};
    return found->second;
  }

  bool is_freed(std::size_t i, double time) {
    const Vector3d point = recorded_point(i);
    const auto holds = [&](const Box& box) { return box.contains(point, kMargin); };
    const std::vector<Box>& old_boxes = moment(time).before;
    if (std::any_of(old_boxes.begin(), old_boxes.end(), holds)) return true;
    const std::vector<Box> then = boxes_at(edited_.before, sweep_.timestamp + double(points_.times[i]));
    return std::any_of(then.begin(), then.end(), holds);
  }

  std::vector<Beam> touched() {
    std::vector<Beam> beams;
    for (std::size_t i = 0; i < points_.size(); ++i) {
      const SeenFrom from = seen_from(sweep_, points_, i);
      const Vector3d arm = recorded_point(i) - from.origin;
      Beam beam{i, from, arm.normalized(), arm.norm(), is_freed(i, from.time), 0, 0, 0};
      const std::vector<Box>& new_boxes = moment(from.time).after;
      const bool meets = std::any_of(new_boxes.begin(), new_boxes.end(), [&](const Box& box) {
        const auto span = box.span(from.origin, beam.direction);
        return span && span->enter < beam.recorded;
      });
      if (beam.recorded > 0 && (beam.freed || meets)) beams.push_back(beam);
    }
    return beams;
  }

  LidarReturns measure(const std::vector<Beam*>& beams) const {
    WorldRays rays{log_.scene, sweep_.timestamp, {}, {}};
    for (const Beam* beam : beams) {
      const Eigen::Vector3f from = (beam->from.origin + beam->start * beam->direction).cast<float>(),
                            along = beam->direction.cast<float>();
      rays.origins.insert(rays.origins.end(), from.data(), from.data() + 3);
      rays.directions.insert(rays.directions.end(), along.data(), along.data() + 3);
      if (sweep_.velocity) rays.times.push_back(beam->from.time);
    }
    return street_.measure(rays);
  }

  /// Gives the beams their depths; those that ended on a ghost are handed back, with a start behind it.
  std::vector<Beam*> ask(const std::vector<Beam*>& beams) {
    const LidarReturns returns = measure(beams);
    std::vector<Beam*> again;
    for (std::size_t i = 0; i < beams.size(); ++i) {
      Beam& beam = *beams[i];
      const double depth = returns.depths[i] > 0 ? beam.start + double(returns.depths[i]) : beam.ground;
      const bool is_hit = depth > 0 && edited_.has(returns.actors[i]);
      const bool is_missing = !returns.drops.empty() && returns.drops[i] > kMissing;
      if (!returns.intensities.empty()) beam.intensity = returns.intensities[i];
      if (!beam.freed) {
        const bool changes = is_hit && depth < beam.recorded;
        beam.depth = !changes ? beam.recorded : is_missing ? 0 : depth;
        continue;
      }
      beam.depth = depth;
      const auto ghost = depth > 0 ? old_box_around(beam) : std::nullopt;
      if (!ghost && is_missing) beam.depth = 0;
      if (!ghost) continue;
      beam.start = ghost->leave + kBeyond;
      // Actors stand on the ground, in which a ray from their box's bottom already is.
      beam.ground = ghost->below ? beam.start : 0;
      again.push_back(&beam);
    }
    return again;
  }

  /// The old box that the beam's answer lies in, unless an actor is there now. Whom the street names does not count:
  /// depths are blended, and may lie before the actor that they are mostly of.
  std::optional<Span> old_box_around(const Beam& beam) {
    const Vector3d point = beam.from.origin + beam.depth * beam.direction;
    const Placed& now = moment(beam.from.time);
    for (const Box& box : now.present) {
      if (box.contains(point, kSurface)) return std::nullopt;
    }
    for (const Box& box : now.before) {
      const auto span = box.span(beam.from.origin, beam.direction);
      if (span && beam.depth >= span->enter && beam.depth <= span->leave) return span;
    }
    return std::nullopt;
  }

  void write(const std::vector<Beam>& beams) {
    LidarPoints& out = result_.points;
    out.dropped = points_.dropped;
    auto beam = beams.begin();
    for (std::size_t i = 0; i < points_.size(); ++i) {
      const bool asked = beam != beams.end() && beam->point == i;
      const Beam* answer = asked ? &*beam++ : nullptr;
      const bool changes = answer && (answer->freed || answer->depth != answer->recorded);
      const bool is_gone = changes && answer->depth <= 0;
      result_.changed += changes;
      result_.gone += is_gone;
      if (is_gone) continue;
      Eigen::Vector3f at(&points_.positions[3 * i]);
      if (changes) at = (answer->from.origin + answer->depth * answer->direction).cast<float>();
      out.positions.insert(out.positions.end(), at.data(), at.data() + 3);
      out.intensities.push_back(changes && answer->intensity ? *answer->intensity : points_.intensities[i]);
      out.times.push_back(points_.times[i]);
      out.sensors.push_back(points_.sensors[i]);
    }
  }

  Street& street_;
  const EditedLog& log_;
  const Sweep& sweep_;
  const LidarPoints& points_;
  const Edited edited_;
  std::map<double, Placed> moments_;
  SweepEdit result_;
};

}  // namespace

SweepEdit edited_sweep(Street& street, const EditedLog& log, const Sweep& sweep, const LidarPoints& recorded) {
  return SweepEditor(street, log, sweep, recorded).run();
}

}  // namespace cloam
