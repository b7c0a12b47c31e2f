// The way of an edit through the program: a street made and learnt for a moment, edited, simulated, read back.
#include <doctest/doctest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <nlohmann/json.hpp>

#include "models/data/load_sweep.h"
#include "models/data/read_scene.h"
#include "models/io/commit.h"
#include "tests/cli/process.h"
#include "tests/cli/small_street.h"

using namespace cloam;
namespace fs = std::filesystem;
using Eigen::Vector3d;

namespace {

std::vector<Vector3d> points_of(const Scene& log, std::size_t sweep) {
  const LidarPoints points = load_sweep(log, log.sweeps.at(sweep));
  std::vector<Vector3d> out;
  for (std::size_t i = 0; i < points.size(); ++i) {
    out.push_back(Eigen::Map<const Eigen::Vector3f>(&points.positions[3 * i]).cast<double>());
  }
  return out;
}

bool holds(const Actor& actor, std::size_t box, const Vector3d& point, double margin) {
  const Vector3d p = (actor.boxes.at(box).world_from_box.inverse() * point.homogeneous()).head<3>();
  return (p.cwiseAbs() - actor.size / 2).maxCoeff() < margin;
}

std::size_t count_in(const Scene& log, std::size_t sweep, const Actor& actor, double margin) {
  std::size_t count = 0;
  for (const Vector3d& point : points_of(log, sweep)) count += holds(actor, sweep, point, margin);
  return count;
}

/// The actor with a box at every step and the most returns in its first.
const Actor& most_seen(const Scene& log) {
  std::size_t most = 0;
  const Actor* seen = &log.actors.front();
  for (const Actor& actor : log.actors) {
    const std::size_t count = actor.boxes.size() == log.sweeps.size() ? count_in(log, 0, actor, 0) : 0;
    if (count > most) most = count, seen = &actor;
  }
  REQUIRE(most > 10);
  return *seen;
}

}  // namespace

TEST_CASE("simulate after remove: boxes and LiDAR of the actor are gone, all that it did not touch is as it was") {
  const Scene before = read_scene(small_street());
  const Actor& removed = most_seen(before);
  const fs::path edited = scratch() / "removed_run", out = scratch() / "removed_log";
  const Outcome edit =
      cloam_with({"edit", small_street_run().string(), "--actor", removed.id + ":remove", "-o", edited.string()});
  REQUIRE_MESSAGE(edit.code == 0, edit.err);
  const Outcome simulated = cloam_with({"simulate", edited.string(), "-o", out.string(), "--json"});
  REQUIRE_MESSAGE(simulated.code == 0, simulated.err);
  const auto json = nlohmann::json::parse(simulated.out);
  CHECK(json["images"] == 3);
  CHECK(json["sweeps"] == 3);

  const Scene after = read_scene(out);
  CHECK(after.format == "PandaSet");
  CHECK(after.frames.size() == 3);
  CHECK(after.cameras.front() == before.cameras.front());
  CHECK(after.actors.size() + 1 == before.actors.size());
  for (const Actor& actor : after.actors) CHECK(actor.id != removed.id);
  std::size_t changed = 0, total = 0;
  for (std::size_t s = 0; s < 3; ++s) {
    CHECK(count_in(after, s, removed, -1e-3) == 0);  // whatever a model of one step believes
    const auto was = points_of(before, s), is = points_of(after, s);
    total += is.size();
    std::size_t at = 0, lost = 0;  // what was not touched comes in the same order, to the bit
    for (const Vector3d& point : was) {
      changed += holds(removed, s, point, 0.2);
      if (holds(removed, s, point, 2)) continue;  // it may have been on the actor when its beam came by
      const auto found = std::find(is.begin() + std::ptrdiff_t(at), is.end(), point);
      if (found == is.end())
        ++lost;
      else
        at = std::size_t(found - is.begin()) + 1;
    }
    CHECK(lost == 0);
  }
  CHECK(json["returns"] == total);
  CHECK(json["returns_changed"].get<std::size_t>() >= changed);
  CHECK(cloam_with({"check", out.string()}).code == 0);
  CHECK(cloam_with({"simulate", edited.string(), "-o", out.string()}).code == 2);  // never among the files of another
}

TEST_CASE("simulate after shift: the boxes move by what was asked for; size and cameras are chosen") {
  const Scene before = read_scene(small_street());
  const Actor& moved = most_seen(before);
  const fs::path edited = scratch() / "moved_run", out = scratch() / "moved_log";
  REQUIRE(cloam_with({"edit", small_street_run().string(), "--actor", moved.id + ":shift=1,0,0", "-o", edited.string()})
              .code == 0);
  const Outcome simulated =
      cloam_with({"simulate", edited.string(), "-o", out.string(), "--size", "32x18", "--cameras", "front", "-q"});
  REQUIRE_MESSAGE(simulated.code == 0, simulated.err);
  const Scene after = read_scene(out);
  CHECK(after.cameras.front().width == 32);
  CHECK(after.cameras.front().fx == doctest::Approx(before.cameras.front().fx * 32 / 48));
  for (const Actor& actor : after.actors) {
    const auto was = std::find_if(before.actors.begin(), before.actors.end(),
                                  [&](const Actor& other) { return other.id == actor.id; });
    REQUIRE(was != before.actors.end());
    const Eigen::Matrix4d change = was->boxes[0].world_from_box.inverse() * actor.boxes[0].world_from_box;
    Eigen::Matrix4d wanted = Eigen::Matrix4d::Identity();
    if (actor.id == moved.id) wanted(0, 3) = 1;
    CHECK(change.isApprox(wanted, 1e-6));
  }
  CHECK(cloam_with({"simulate", edited.string(), "-o", (out / "x").string(), "--cameras", "rear"}).code == 2);
}

TEST_CASE("simulate: another log, a folder in use and a shift out of the world are refused, and nothing is left") {
  const std::string run = small_street_run().string();
  const fs::path other = scratch() / "other_street", out = scratch() / "refused_log";
  fs::copy(small_street(), other, fs::copy_options::recursive);
  const Scene log = read_scene(other);
  fs::copy_file(other / log.frames[1].image, other / log.frames[0].image, fs::copy_options::overwrite_existing);
  const Outcome wrong = cloam_with({"simulate", run, "-o", out.string(), "--data", other.string()});
  CHECK(wrong.code == 3);
  CHECK(contains(wrong.err, "is not what"));
  CHECK_FALSE(fs::exists(out));
  {
    const FolderLock lock(out);
    const Outcome held = cloam_with({"simulate", run, "-o", out.string()});
    CHECK(held.code == 2);
    CHECK(contains(held.err, "is in use by process"));
  }
  CHECK(cloam_with({"simulate", run, "-o", out.string(), "--cameras", "rear"}).code == 2);
  CHECK_FALSE(fs::exists(out));
  const std::string actor = log.actors.front().id;
  CHECK(cloam_with({"edit", run, "--actor", actor + ":shift=1e30,0,0", "-o", (out / "far").string()}).code == 2);
  CHECK(cloam_with({"simulate", run, "-o", out.string(), "--seed", "5"}).code == 2);
}
