// See video_frames.h.
#include "cli/video_frames.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <nlohmann/json.hpp>

#include "cli/child_program.h"
#include "cli/common.h"
#include "cli/stop_signal.h"
#include "models/io/commit.h"
#include "models/io/words.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr std::size_t kFewestFrames = 3, kMostFrames = 5000;

fs::path program_of_ffmpeg(const std::string& name) {
  const fs::path found = find_program(name);
  if (!found.empty()) return found;
  throw Error(Fault::usage, text("frames of a video are taken by ffmpeg, which is not installed (no ", name,
                                 " in PATH)\n  fix: apt-get install ffmpeg"));
}

/// A number among ffprobe's words ("12.5", "30000/1001"); 0 where there is none.
double number_of(const nlohmann::json& object, const char* key) {
  const auto found = object.find(key);
  if (found == object.end() || !found->is_string()) return 0;
  double above = 0, below = 1;
  const int parts = std::sscanf(found->get_ref<const std::string&>().c_str(), "%lf/%lf", &above, &below);
  return parts >= 1 && below > 0 && std::isfinite(above) ? above / below : 0;
}

/// "" for what ffprobe calls unknown.
std::string known_word(const nlohmann::json& object, const char* key) {
  const auto found = object.find(key);
  const std::string word = found != object.end() && found->is_string() ? found->get<std::string>() : "";
  return word == "unknown" || word == "reserved" ? "" : word;
}

/// ffprobe's rotation counts against the clock.
int turn_of(const nlohmann::json& stream) {
  for (const nlohmann::json& side : stream.value("side_data_list", nlohmann::json::array()))
    if (const auto rotation = side.find("rotation"); rotation != side.end() && rotation->is_number())
      return (720 - static_cast<int>(std::lround(rotation->get<double>()))) % 360;
  return 0;
}

nlohmann::json probed(const fs::path& file) {
  const fs::path ffprobe = program_of_ffmpeg("ffprobe");
  std::string said;
  const ChildEnd end = run_child({ffprobe,
                                  {"-v", "quiet", "-show_error", "-show_streams", "-show_format", "-select_streams",
                                   "V:0", "-of", "json", fs::absolute(file).string()}},
                                 [&](const std::string& line) { said += line + "\n"; });
  const nlohmann::json found = nlohmann::json::parse(said, nullptr, false);
  if (found.is_object() && end.code == 0) return found;
  const bool known = found.is_object() && found.contains("error");
  throw Error(Fault::data, text(file.string(), ": is no video that ffmpeg can read, or is damaged (",
                                known ? found["error"].value("string", "") : "ffprobe " + end.in_words(),
                                ")\n  fix: copy it again from the phone, or give a folder of photos"));
}

/// Pictures and texts, which ffmpeg would show as videos.
bool is_video(const nlohmann::json& found) {
  const std::string format = found.value("format", nlohmann::json::object()).value("format_name", "");
  return !found.value("streams", nlohmann::json::array()).empty() && format != "tty" && format != "image2" &&
         !format.ends_with("_pipe");
}

bool can_tone_map() {
  int found = 0;
  run_child({program_of_ffmpeg("ffmpeg"), {"-hide_banner", "-filters"}}, [&](const std::string& line) {
    found += line.find(" zscale ") != std::string::npos || line.find(" tonemap ") != std::string::npos;
  });
  return found == 2;
}

/// From any video to what a JPEG file holds: BT.601's matrix in the full range, square pixels. White paper has 203 nits
/// in videos of high range (ITU-R BT.2408) and becomes 1; what is darker than 0.3 stays as it is, and 1015 nits become
/// white.
std::string colour_filter(const Video& video) {
  const std::string end = "setsar=1,format=yuvj420p";
  if (video.high_range().empty() || !video.tone_maps) {
    const bool silent = video.matrix.empty() && std::min(video.width, video.height) >= 720;  // BT.709 to players
    return text("scale=w=iw*sar:h=ih:in_color_matrix=", silent ? "bt709" : "auto",
                ":out_color_matrix=bt601:out_range=full,", end);
  }
  const std::string primaries = video.primaries.empty() ? "bt2020" : video.primaries;
  const std::string matrix = video.matrix.empty() ? "bt2020nc" : video.matrix;
  return text("zscale=tin=", video.transfer, ":pin=", primaries, ":min=", matrix,
              ":t=linear:npl=203,format=gbrpf32le,zscale=p=bt709,tonemap=tonemap=mobius:peak=5:desat=0,"
              "zscale=t=bt709:m=bt470bg:r=full,",
              end);
}

struct Seen {
  int number = 0;
  double time = 0, sharpness = 0;
};

/// What ffmpeg prints, told apart: its filter's lines, its progress, complaints.
class Measurements {
 public:
  explicit Measurements(double rate) : rate_(rate > 0 ? rate : 30) {}

  void take(const std::string& line) {
    int number = 0, end = 0;
    char time[32] = "";
    double sharpness = 0;
    if (std::sscanf(line.c_str(), "frame:%d pts:%*s pts_time:%31s%n", &number, time, &end) == 2 && end > 0) {
      char* rest = nullptr;
      const double seconds = std::strtod(time, &rest);
      now_ = {number, rest != time && *rest == 0 ? seconds : number / rate_, 0};
    } else if (std::sscanf(line.c_str(), "lavfi.signalstats.YAVG=%lf", &sharpness) == 1) {
      seen.push_back({now_.number, now_.time, sharpness});
    } else {
      complaints.push_back(line);
    }
  }

  std::vector<Seen> seen;
  std::vector<std::string> complaints;

 private:
  double rate_;
  Seen now_;
};

/// The convolution cuts off what is negative, half of the Laplacian.
constexpr char kMeasure[] =
    "scale=w='min(iw,1280)':h=-2:flags=area,format=gray,convolution=0m='0 1 0 1 -4 1 0 1 0',signalstats,"
    "metadata=mode=print:key=lavfi.signalstats.YAVG:file=-";

[[noreturn]] void failed(const Video& video, const ChildEnd& end, const fs::path& folder) {
  if (end.is_of_full_disk())
    throw Error(Fault::write, text("cannot write frames: ", space_advice(folder), "; ffmpeg printed:", end.said));
  throw Error(Fault::data, text(video.file.string(), ": ffmpeg ", end.in_words()));
}

std::vector<std::string> words_for(const Video& video, const std::string& filter) {
  return {"-nostdin", "-hide_banner", "-v",  "error", "-i",        fs::absolute(video.file).string(),
          "-map",     "0:V:0",        "-vf", filter,  "-fps_mode", "passthrough"};
}

std::vector<Seen> measured(const Video& video, const FrameListener& listener) {
  listener.begin("looking for sharp frames");
  Measurements found(video.rate);
  std::vector<std::string> words = words_for(video, kMeasure);
  words.insert(words.end(), {"-f", "null", "-"});
  const ChildEnd end = run_child({program_of_ffmpeg("ffmpeg"), words}, [&](const std::string& line) {
    found.take(line);
    if (!found.seen.empty() && video.seconds > 0)
      listener.draw(std::clamp((found.seen.back().time - found.seen.front().time) / video.seconds, 0.0, 1.0));
  });
  if (stop_signal.load() != 0) return {};
  if (end.code != 0) failed(video, end, fs::temp_directory_path());
  if (!found.complaints.empty())
    warn(text(video.file.string(), ": a part is damaged; ffmpeg printed ", found.complaints.size(),
              " lines, the first: ", found.complaints.front()));
  return found.seen;
}

/// Numbers of frames, rising.
std::vector<int> sharpest(const Video& video, const std::vector<Seen>& seen, const FrameWish& wish) {
  const double begin = seen.empty() ? 0 : seen.front().time;
  const double length = seen.size() < 2 ? 0
                                        : (seen.back().time - begin) * static_cast<double>(seen.size()) /
                                              static_cast<double>(seen.size() - 1);
  const double part = wish.count > 0 ? length / wish.count : 1 / wish.fps;
  std::map<std::int64_t, Seen> best;
  for (const Seen& frame : seen) {
    // Times have six digits: one that falls on a border belongs to the part behind it.
    const auto place = part > 0 ? static_cast<std::int64_t>(std::floor((frame.time - begin) / part + 1e-4)) : 0;
    const auto [at, is_new] = best.emplace(place, frame);
    if (!is_new && frame.sharpness > at->second.sharpness) at->second = frame;
  }
  std::vector<int> numbers;
  for (const auto& [place, frame] : best) numbers.push_back(frame.number);
  std::sort(numbers.begin(), numbers.end());
  const std::string gives = text(video.file.string(), ": gives ", numbers.size(), " of ", seen.size(), " frames (",
                                 fmt::format("{:.1f}", length), " s)");
  if (numbers.size() < kFewestFrames)
    throw Error(Fault::data,
                text(gives, ", want ", kFewestFrames, " or more\n  fix: ",
                     seen.size() < kFewestFrames ? "" : "more of them with --fps 10, or ", "a longer video"));
  if (numbers.size() > kMostFrames)
    throw Error(Fault::usage, text(gives, ", want ", kMostFrames, " at most\n  fix: --frames 300"));
  return numbers;
}

/// 1.jpg and so on, as ffmpeg counts what it writes.
void write_frames(const Video& video, const std::vector<int>& numbers, const fs::path& folder,
                  const FrameListener& listener) {
  std::error_code error;
  fs::remove_all(folder, error);
  fs::create_directories(folder, error);
  if (error) throw Error(Fault::write, text(folder.string(), ": cannot be created: ", error.message()));
  std::string chosen, pattern;
  for (const int number : numbers) chosen += text(chosen.empty() ? "" : "+", "eq(n,", number, ")");
  for (const char letter : fs::absolute(folder).string()) pattern += letter == '%' ? "%%" : std::string(1, letter);
  std::vector<std::string> words = words_for(video, text("select='", chosen, "',", colour_filter(video)));
  words.insert(words.end(), {"-qmin", "1", "-q:v", "1", "-progress", "pipe:1", "-nostats", "-f", "image2", "-y",
                             pattern + "/%d.jpg"});
  const ChildEnd end = run_child({program_of_ffmpeg("ffmpeg"), words}, [&](const std::string& line) {
    int done = 0;
    if (std::sscanf(line.c_str(), "frame=%d", &done) == 1)
      listener.draw(std::min(1.0, done / static_cast<double>(numbers.size())));
  });
  if (stop_signal.load() == 0 && (end.code != 0 || end.is_of_full_disk())) failed(video, end, folder);
}

/// Gives each file the name of its place in the video.
void name_frames(const Video& video, const std::vector<int>& numbers, const fs::path& folder) {
  std::error_code error;
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    fs::rename(folder / fmt::format("{}.jpg", i + 1), folder / fmt::format("frame_{:06d}.jpg", numbers[i]), error);
    if (error)
      throw Error(Fault::data, text(video.file.string(), ": ffmpeg gave ", i, " of ", numbers.size(),
                                    " frames that it had shown before; the file may be damaged"));
  }
}

}  // namespace

std::string Video::high_range() const {
  return transfer == "arib-std-b67" ? "HLG" : transfer == "smpte2084" ? "PQ" : "";
}

Video read_video(const fs::path& file) {
  program_of_ffmpeg("ffmpeg");
  const nlohmann::json found = probed(file);
  if (!is_video(found)) throw Error(Fault::data, file.string() + ": is no video; give a video or a folder of photos");
  const nlohmann::json& stream = found["streams"][0];
  const double seconds = number_of(stream, "duration");
  Video video{file,
              stream.value("codec_name", "unknown codec"),
              stream.value("width", 0),
              stream.value("height", 0),
              number_of(stream, "avg_frame_rate"),
              seconds > 0 ? seconds : number_of(found.value("format", nlohmann::json::object()), "duration"),
              turn_of(stream),
              known_word(stream, "color_transfer"),
              known_word(stream, "color_primaries"),
              known_word(stream, "color_space")};
  video.tone_maps = !video.high_range().empty() && can_tone_map();
  return video;
}

std::string in_words(const Video& video) {
  std::string words = fmt::format("{}, {}x{}", video.codec, video.width, video.height);
  if (video.rate > 0) words += fmt::format(", {:.4g} frames/s", video.rate);
  if (video.seconds > 0) words += ", " + words_for_seconds(video.seconds);
  if (video.turn != 0) words += text("; turned by ", video.turn, " degrees, as the file says");
  if (!video.high_range().empty())
    words += text("; ", video.high_range(), " (HDR)", video.tone_maps ? ", tone mapped" : "");
  return words;
}

void take_frames(const Video& video, const FrameWish& wish, const fs::path& folder, const FrameListener& listener) {
  if (!video.high_range().empty() && !video.tone_maps)
    warn(text("the video is HDR (", video.high_range(),
              "), and this ffmpeg lacks the filters zscale and tonemap: its frames will be pale\n  fix: record without "
              "HDR, or use Debian's ffmpeg"));
  const std::vector<Seen> seen = measured(video, listener);
  if (stop_signal.load() != 0) return;
  const std::vector<int> numbers = sharpest(video, seen, wish);
  listener.begin(text("taking the ", numbers.size(), " sharpest of ", seen.size(), " frames"));
  const fs::path part = folder.string() + ".part";
  write_frames(video, numbers, part, listener);
  if (stop_signal.load() != 0) return;
  name_frames(video, numbers, part);
  fs::rename(part, folder);
}

}  // namespace cloam
