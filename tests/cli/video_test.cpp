// cloam process with videos: which frames it takes, their colours and their turn, and what it says of bad ones. COLMAP
// is a stand-in that only notes what it was asked, but in the last test.
#include <doctest/doctest.h>
#include <signal.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "models/io/image.h"
#include "models/io/words.h"
#include "tests/cli/process.h"
#include "tests/models/errors.h"

namespace fs = std::filesystem;
using namespace cloam;

namespace {

bool no_ffmpeg() {
  const bool missing = !fs::exists("/usr/bin/ffmpeg");
  if (missing) MESSAGE("skipped: no ffmpeg");
  return missing;
}

void write_program(const fs::path& path, const std::string& script) {
  fs::create_directories(path.parent_path());
  write_text(path, "#!/bin/sh\n" + script);
  fs::permissions(path, fs::perms::owner_all);
}

struct Bench {
  explicit Bench(const std::string& name) : root(scratch() / name) {
    write_program(root / "bin/colmap", "echo \"$@\" >> '" + (root / "calls").string() + "'\n");
  }

  /// A film by ffmpeg: its words up to the file.
  fs::path film(const std::string& name, const std::string& words) const {
    const fs::path path = root / name;
    REQUIRE(std::system(("/usr/bin/ffmpeg -v error -y " + words + " " + quoted(path.string())).c_str()) == 0);
    return path;
  }
  /// 60 frames in two seconds that are blurred but for every fifteenth, the eighth of each half second.
  fs::path blurred(const std::string& name, const std::string& words = "-crf 12") const {
    return film(name,
                "-f lavfi -i testsrc2=size=320x240:rate=30:duration=2 -vf \"gblur=sigma=1.5:enable='mod(n,15)-7'\""
                " -pix_fmt yuv420p " +
                    words);
  }
  /// A film of one colour: 30 frames of planes in numbers of `bytes` bytes.
  fs::path plain(const std::string& name, const std::array<int, 3>& yuv, const std::string& format,
                 const std::string& words) const {
    constexpr int width = 1280, height = 720;
    const bool deep = format.ends_with("10le");
    std::ofstream raw(root / "raw", std::ios::binary);
    for (int plane = 0; plane < 3; ++plane)
      for (int i = 0; i < width * height; ++i) {
        raw.put(static_cast<char>(yuv[std::size_t(plane)] & 255));
        if (deep) raw.put(static_cast<char>(yuv[std::size_t(plane)] >> 8));
      }
    raw.close();
    return film(name, "-stream_loop 29 -f rawvideo -s 1280x720 -pix_fmt " + format + " -i '" + (root / "raw").string() +
                          "' " + words);
  }

  Outcome process(const fs::path& video, const Words& more = {}, const Words& environment = {}) const {
    Words words = {"process", video.string(), "-o", (root / "data").string()};
    words.insert(words.end(), more.begin(), more.end());
    const Words usual = {"PATH=" + (root / "bin").string() + ":/usr/bin:/bin"};
    return cloam_with(words, environment.empty() ? usual : environment);
  }
  fs::path frames() const { return root / "data/colmap/frames"; }
  Words names() const {
    Words found;
    if (!fs::exists(frames())) return {};
    for (const auto& entry : fs::directory_iterator(frames())) found.push_back(entry.path().filename());
    std::sort(found.begin(), found.end());
    return found;
  }
  /// The mean colour of its first frame.
  std::array<double, 3> colour() const {
    REQUIRE(!names().empty());
    const Image image = read_image(frames() / names().front());
    std::array<double, 3> sum{};
    for (std::size_t i = 0; i < image.pixels.size(); ++i) sum[i % 3] += image.pixels[i];
    for (double& value : sum) value /= image.width * double(image.height);
    return sum;
  }

  fs::path root;
};

double psnr(const Image& a, const Image& b) {
  REQUIRE(a.width == b.width);
  REQUIRE(a.height == b.height);
  REQUIRE(a.channels == b.channels);
  double sum = 0;
  for (std::size_t i = 0; i < a.pixels.size(); ++i) sum += std::pow(double(a.pixels[i]) - b.pixels[i], 2);
  return 10 * std::log10(255 * 255 / (sum / double(a.pixels.size())));
}

/// A quarter turn with the clock.
Image turned(const Image& image) {
  Image out{image.height, image.width, image.channels, {}};
  for (int y = 0; y < out.height; ++y)
    for (int x = 0; x < out.width; ++x)
      for (int c = 0; c < out.channels; ++c)
        out.pixels.push_back(
            image.pixels[std::size_t(((image.height - 1 - x) * image.width + y) * image.channels + c)]);
  return out;
}

/// The matrix in the header of an MP4 file's track, as a phone writes it that was held upright: x of a pixel becomes y,
/// y becomes width - x.
void say_turned(const fs::path& film) {
  std::string bytes = content_of(film);
  const std::string one("\0\1\0\0", 4), minus("\xff\xff\0\0", 4), none(4, '\0'), last("\x40\0\0\0", 4);
  const std::string identity = one + none + none + none + one + none + none + none + last;
  const std::size_t track = bytes.find("tkhd"), at = bytes.find(identity, track);
  REQUIRE(track != std::string::npos);
  REQUIRE(at != std::string::npos);
  bytes.replace(at, identity.size(), none + one + none + minus + none + none + none + none + last);
  std::ofstream(film, std::ios::binary) << bytes;
}

}  // namespace

TEST_CASE("process takes the sharpest frame of each half second of a video") {
  if (no_ffmpeg()) return;
  const Bench bench("video");
  for (const char* name : {"walk.mp4", "walk.mov", "walk.mkv", "walk.webm", "it's 100 % sharp.mp4"}) {
    CAPTURE(name);
    const bool webm = fs::path(name).extension() == ".webm";
    const Outcome made =
        bench.process(bench.blurred(name, webm ? "-c:v libvpx-vp9 -cpu-used 8 -crf 20" : "-crf 12"), {"--overwrite"});
    CHECK_MESSAGE(made.code == 3, made.err);  // the stand-in matches nothing
    CHECK(holds(made.err, "320x240, 30 frames/s, 2s"));
    CHECK(bench.names() == Words{"frame_000007.jpg", "frame_000022.jpg", "frame_000037.jpg", "frame_000052.jpg"});
  }
  const std::string calls = content_of(bench.root / "calls");
  CHECK(holds(calls, "--image_path " + bench.frames().string()));
  CHECK(holds(calls, "--ImageReader.single_camera 1"));
  CHECK(holds(calls, "sequential_matcher"));
  CHECK_FALSE(holds(calls, "exhaustive_matcher"));

  const fs::path sharp = bench.film("sharp.png",
                                    "-f lavfi -i testsrc2=size=320x240:rate=30:duration=2 -vf "
                                    "\"select='eq(n,7)',format=rgb24\" -frames:v 1");
  CHECK(psnr(read_image(bench.frames() / "frame_000007.jpg"), read_image(sharp)) >
        24);  // a blurred one: 19; colours have half the resolution

  bench.process(bench.root / "walk.mp4", {"--overwrite", "--frames", "3", "--matching", "exhaustive"});
  CHECK(bench.names().size() == 3);
  CHECK(holds(content_of(bench.root / "calls"), "exhaustive_matcher"));
}

TEST_CASE("process turns frames as the video says") {
  if (no_ffmpeg()) return;
  const Bench bench("video-turned");
  const fs::path film = bench.blurred("walk.mp4");
  bench.process(film);
  const Image stored = read_image(bench.frames() / "frame_000007.jpg");
  CHECK(stored.width == 320);
  say_turned(film);
  const Outcome made = bench.process(film, {"--overwrite"});
  CHECK(holds(made.err, "turned by 90 degrees, as the file says"));
  const Image upright = read_image(bench.frames() / "frame_000007.jpg");
  CHECK(upright.width == 240);
  CHECK(psnr(upright, turned(stored)) > 30);
}

TEST_CASE("frames have the colours of the video") {
  if (no_ffmpeg()) return;
  const Bench bench("video-colours");
  // (200, 60, 40) by BT.709 in the studio range: what players take a large film for that says nothing.
  const fs::path film = bench.plain("red.mp4", {92, 105, 190}, "yuv444p", "-pix_fmt yuv420p -qp 0");
  bench.process(film, {"--fps", "10"});
  const auto colour = bench.colour();
  CHECK(colour[0] == doctest::Approx(200).epsilon(0.02));
  CHECK(colour[1] == doctest::Approx(60).epsilon(0.06));
  CHECK(colour[2] == doctest::Approx(40).epsilon(0.09));
}

TEST_CASE("a video of a high dynamic range is tone mapped, or a warning says that it is not") {
  if (no_ffmpeg()) return;
  const Bench bench("video-hdr");
  // The linear red (0.2, 0.01, 0.01) of BT.709 in BT.2020's primaries, by the curve of HLG (ITU-R BT.2100): signals of
  // 0.623, 0.263 and 0.198. So green is 0.42 of red if they are taken for BT.709's, and 0.26 by the curve of BT.709.
  const std::array<int, 3> yuv = {374, 438, 676};
  const fs::path film = bench.plain("hlg.mp4", yuv, "yuv444p10le",
                                    "-pix_fmt yuv420p10le -c:v libx265 -x265-params log-level=error -crf 4 -color_trc "
                                    "arib-std-b67 -color_primaries bt2020 -colorspace bt2020nc");
  const Outcome mapped = bench.process(film, {"--fps", "10"});
  CHECK(holds(mapped.err, "HLG (HDR), tone mapped"));
  CHECK(bench.colour()[1] / bench.colour()[0] < 0.32);
  CHECK(bench.colour()[0] > 60);

  write_program(bench.root / "bin/ffmpeg", "case \"$*\" in *-filters*) exit 0 ;; esac\nexec /usr/bin/ffmpeg \"$@\"\n");
  const Outcome pale = bench.process(film, {"--fps", "10", "--overwrite"});
  CHECK(holds(pale.err, "lacks the filters zscale and tonemap"));
  CHECK(bench.colour()[1] / bench.colour()[0] > 0.36);
}

TEST_CASE("process says what is wrong with a video") {
  if (no_ffmpeg()) return;
  const Bench bench("video-bad");
  const fs::path film = bench.blurred("walk.mp4");
  const auto refused = [&](const fs::path& path, int code, const Words& more = {}, const Words& environment = {}) {
    const Outcome outcome = bench.process(path, more, environment);
    CHECK_MESSAGE(outcome.code == code, outcome.err);
    return outcome.err;
  };
  fs::create_symlink("/usr/bin/ffmpeg", bench.root / "bin/ffmpeg");
  const Words own = {"PATH=" + (bench.root / "bin").string()};
  CHECK(holds(refused(film, 2, {}, own), "no ffprobe in PATH"));
  fs::remove(bench.root / "bin/ffmpeg");
  CHECK(holds(refused(film, 2, {}, own), "apt-get install ffmpeg"));

  write_text(bench.root / "cut.mp4", content_of(film).substr(0, fs::file_size(film) / 2));
  CHECK(holds(refused(bench.root / "cut.mp4", 3), "Invalid data found when processing input"));
  write_text(bench.root / "notes.txt", std::string(4000, 'a') + "\n");
  CHECK(holds(refused(bench.root / "notes.txt", 3), "notes.txt: is no video"));
  bench.film("tone.mp4", "-f lavfi -i sine=duration=1");
  CHECK(holds(refused(bench.root / "tone.mp4", 3), "tone.mp4: is no video"));
  CHECK(holds(refused(bench.root / "nowhere.mp4", 3), "no such folder or video"));
  CHECK(holds(refused(film, 3, {"--fps", "0.5"}), "gives 1 of 60 frames (2.0 s), want 3 or more"));
  const std::string one = refused(bench.film("one.mp4", "-f lavfi -i testsrc2=size=320x240:rate=30 -frames:v 1"), 3);
  CHECK_MESSAGE(holds(one, "gives 1 of 1 frames (0.0 s), want 3 or more  [exit 3]\n  fix: a longer video"), one);
  CHECK(holds(refused(film, 2, {"--fps", "1", "--frames", "9"}), "not both"));
  CHECK(holds(refused(bench.root, 2, {"--fps", "1"}), "is a folder"));
  CHECK(bench.names().empty());

  std::string bytes = content_of(film);
  const std::size_t middle = bytes.find("mdat") + 20000;
  for (std::size_t i = 0; i < 2000; ++i) bytes[middle + i] = static_cast<char>(i * 37);
  write_text(bench.root / "scratched.mp4", bytes);
  CHECK(holds(refused(bench.root / "scratched.mp4", 3), "scratched.mp4: a part is damaged; ffmpeg printed"));
}

TEST_CASE("process ends ffmpeg when it is interrupted, and does not take the same frames twice") {
  if (no_ffmpeg()) return;
  const Bench bench("video-stop");
  const fs::path film = bench.blurred("walk.mp4"), hangs = bench.root / "hangs";
  write_program(bench.root / "bin/ffmpeg", "touch '" + hangs.string() + "'\nsleep 60\n");
  Process process({"process", film.string(), "-o", (bench.root / "data").string()},
                  {"PATH=" + (bench.root / "bin").string() + ":/usr/bin:/bin"});
  REQUIRE(wait_for(hangs, process));
  process.signal(SIGINT);
  const Outcome stopped = process.wait();
  CHECK(stopped.code == 130);
  CHECK(stopped.seconds < 30);
  CHECK(holds(stopped.err, "run the same command again"));
  CHECK(bench.names().empty());
  fs::remove(bench.root / "bin/ffmpeg");
  CHECK(holds(bench.process(film).err, "looking for sharp frames"));
  CHECK(bench.names().size() == 4);
  write_text(bench.root / "data/colmap/database.db", "features of these frames");
  CHECK_FALSE(holds(bench.process(film).err, "looking for sharp frames"));
  CHECK(fs::exists(bench.root / "data/colmap/database.db"));
  CHECK(holds(bench.process(film, {"--fps", "4"}).err, "looking for sharp frames"));
  CHECK_FALSE(fs::exists(bench.root / "data/colmap/database.db"));
  CHECK(bench.names().size() == 8);
}

TEST_CASE("a video becomes a capture with COLMAP itself") {
  const char* given = std::getenv("CLOAM_TEST_DATA");
  const fs::path photos = fs::path(given ? given : "../shared/data") / "fox/images";
  if (no_ffmpeg() || !fs::exists("/usr/bin/colmap") || !fs::exists(photos)) {
    MESSAGE("skipped: no ffmpeg, no colmap, or no data");
    return;
  }
  const Bench bench("video-fox");
  fs::remove(bench.root / "bin/colmap");
  std::vector<fs::path> names;
  for (const auto& entry : fs::directory_iterator(photos)) names.push_back(entry.path());
  std::sort(names.begin(), names.end());
  for (std::size_t i = 0; i < 8; ++i)
    write_png(bench.root / ("photo" + std::to_string(i) + ".png"), downscale(read_image(names[i]), 4));
  // Each photo for half a second, of which only the fourth frame is sharp.
  const fs::path film =
      bench.film("fox.mp4", "-framerate 2 -i '" + (bench.root / "photo%d.png").string() +
                                "' -vf \"fps=10,gblur=sigma=4:enable='mod(n,5)-3'\" -pix_fmt yuv420p -crf 12");
  const Outcome made = bench.process(film, {"--json"});
  CHECK_MESSAGE(made.code == 0, made.err);
  const auto json = nlohmann::json::parse(made.out);
  CHECK(json["images_given"] == 8);
  CHECK(json["images"] >= 6);
  CHECK(json["cameras"] == 1);
  CHECK(cloam_with({"check", (bench.root / "data").string()}).code == 0);
}
