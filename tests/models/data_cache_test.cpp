// What is kept of captures between programs: found again by content, never wrong, never in the way.
#include "models/io/data_cache.h"

#include <doctest/doctest.h>

#include <cstdlib>
#include <fstream>

#include "models/data/kept_sweeps.h"
#include "models/data/load_sweep.h"
#include "models/street/street_sweeps.h"
#include "tests/models/folder.h"
#include "tests/models/toy_street.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

using Kept = std::vector<std::uint8_t>;

/// A cache of this test alone.
struct OwnCache {
  OwnCache() { setenv("CLOAM_DATA_CACHE", (folder.path / "cache").c_str(), 1); }
  ~OwnCache() { unsetenv("CLOAM_DATA_CACHE"); }
  std::vector<fs::path> entries() const {
    std::vector<fs::path> all;
    if (fs::exists(folder.path / "cache"))
      for (const auto& entry : fs::directory_iterator(folder.path / "cache")) all.push_back(entry.path());
    return all;
  }
  const Folder folder;
};

bool same(const LidarPoints& a, const LidarPoints& b) {
  return a.positions == b.positions && a.intensities == b.intensities && a.times == b.times && a.sensors == b.sensors &&
         a.dropped == b.dropped && a.of_ego == b.of_ego;
}

/// The log of toy_street with an actor.
Scene street_in(const fs::path& root) {
  Scene scene = toy_street(root, {.frames = 3});
  scene.actors = {toy_actor("ahead", {2, 4, 3}, 12, 0)};
  return scene;
}

struct Learnt {
  std::vector<float> numbers;
  std::vector<uint8_t> cells;
  std::vector<LidarPoints> sweeps;
  bool operator==(const Learnt& other) const {
    return numbers == other.numbers && cells == other.cells &&
           std::equal(sweeps.begin(), sweeps.end(), other.sweeps.begin(), other.sweeps.end(), same);
  }
};

Learnt learnt(const Scene& scene, const StreetSpaceOptions& options, const std::shared_ptr<HostStore>& store) {
  StreetSpace space(scene, options);
  const LogSweeps sweeps = training_sweeps(scene, space, store);
  Learnt out{space.grid().numbers.to_host(), space.grid().cells.to_host<uint8_t>(), {}};
  for (std::size_t i = 0; i < sweeps.size(); ++i) {
    out.sweeps.push_back(*sweeps.points(i));
    CHECK(sweeps.returns(i) == out.sweeps.back().size());
  }
  return out;
}

std::shared_ptr<HostStore> store_of(uint64_t bytes) { return std::make_shared<HostStore>(bytes, 0); }

}  // namespace

TEST_CASE("an entry is found under the name of all that it depends on, and under no other") {
  const OwnCache cache;
  const auto name = [](const std::string& a, const std::string& b) { return CacheKey("test-1").add(a).add(b).name(); };
  CHECK_FALSE(find_kept(name("a", "b")));
  keep(name("a", "b"), Kept{1, 2, 3});
  CHECK(find_kept(name("a", "b")) == Kept{1, 2, 3});
  CHECK_FALSE(find_kept(name("ab", "")));
  CHECK_FALSE(find_kept(name("b", "a")));
  CHECK(CacheKey("a").add(1).name() != CacheKey("a").add(int64_t{1}).name());
  setenv("CLOAM_DATA_CACHE", "off", 1);
  CHECK_FALSE(find_kept(name("a", "b")));
  keep(name("c", "d"), Kept{1});
  CHECK(cache.entries().size() == 1);
}

TEST_CASE("an entry with a wrong byte, or cut, or in a folder that cannot be, is as good as none") {
  const OwnCache cache;
  keep("test", Kept(100, 7));
  REQUIRE(find_kept("test"));
  const fs::path file = cache.entries().front();
  for (const std::streamoff at : {0, 9, 50}) {
    std::fstream stream(file, std::ios::in | std::ios::out | std::ios::binary);
    stream.seekp(at);
    stream.put('x');
    stream.close();
    CHECK_FALSE(find_kept("test"));
    keep("test", Kept(100, 7));
    CHECK(find_kept("test"));
  }
  fs::resize_file(file, 40);
  CHECK_FALSE(find_kept("test"));
  setenv("CLOAM_DATA_CACHE", "/proc/nothing", 1);
  keep("test", Kept(100, 7));
  CHECK_FALSE(find_kept("test"));
}

TEST_CASE(
    "sweeps and voxels are those of files and memory, cold, kept, with the folder gone, and with one too many bytes") {
  const OwnCache cache;
  const Folder folder;
  const Scene scene = street_in(folder.path);
  const Learnt wanted = learnt(scene, {}, nullptr);
  CHECK(cache.entries().empty());
  REQUIRE(wanted.sweeps.size() == 3);
  for (const uint64_t bytes : {0, 20000, 1 << 20}) CHECK(learnt(scene, {}, store_of(bytes)) == wanted);
  CHECK(cache.entries().size() == 4);  // three sweeps and the voxels
  for (const fs::path& entry : cache.entries()) fs::resize_file(entry, fs::file_size(entry) - 1);
  CHECK(learnt(scene, {}, store_of(0)) == wanted);
  fs::remove_all(cache.folder.path / "cache");
  CHECK(learnt(scene, {}, store_of(0)) == wanted);
  CHECK(cache.entries().size() == 4);
}

TEST_CASE("what is kept of a sweep is of these bytes, this pose and these boxes alone") {
  const OwnCache cache;
  const Folder folder;
  const Scene scene = street_in(folder.path);
  const auto follows = [&](const Scene& changed, const StreetSpaceOptions& options) {
    (void)learnt(scene, {}, store_of(0));  // is kept
    CHECK(learnt(changed, options, store_of(0)) == learnt(changed, options, nullptr));
  };
  follows(scene, {.voxel = 0.7f});
  follows(scene, {.dilate = 2});
  Scene moved = scene;
  moved.sweeps[0].world_from_lidar(0, 3) += 1;
  follows(moved, {});
  Scene driving = scene;
  driving.sweeps[0].velocity = Eigen::Vector3d(20, 0, 0);
  follows(driving, {});
  Scene car = scene;
  car.recording.car = CarBox{{0, 0, 0}, {40, 40, 40}};
  follows(car, {});
  Scene without = scene;
  without.actors.clear();
  follows(without, {});
  Scene turned = scene;
  for (Frame& frame : turned.frames) frame.world_from_camera(1, 3) += 3;
  follows(turned, {});
  fs::copy_file(scene.root / scene.sweeps[1].file, scene.root / scene.sweeps[0].file,
                fs::copy_options::overwrite_existing);
  follows(scene, {});
}

}  // namespace cloam
