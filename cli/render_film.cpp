// See render_film.h.
#include "cli/render_film.h"

#include "cli/child_program.h"
#include "models/io/commit.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

// Left alone, ffmpeg converts to BT.601 and does not say so, and players take large films for BT.709.
constexpr char kFilter[] = "crop=trunc(iw/2)*2:trunc(ih/2)*2:0:0,scale=out_color_matrix=bt709,format=yuv420p";

/// For ffmpeg, which reads % as the beginning of a number's place.
std::string without_places(const std::string& path) {
  std::string out;
  for (const char letter : path) out += letter == '%' ? "%%" : std::string(1, letter);
  return out;
}

/// Paths begin with a slash: ffmpeg takes what stands before a colon for a protocol.
void encode(const fs::path& ffmpeg, const std::vector<std::string>& input, const fs::path& film) {
  std::vector<std::string> words = {"-nostdin", "-hide_banner", "-loglevel", "error", "-xerror", "-y"};
  words.insert(words.end(), input.begin(), input.end());
  for (const char* word : {"-vf", kFilter, "-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc",
                           "iec61966-2-1", "-movflags", "+faststart"})
    words.push_back(word);
  words.push_back(film.string());
  const ChildEnd end = run_child({ffmpeg, words});
  if (end.code == 0) return;
  if (end.is_of_full_disk())
    throw Error(Fault::write,
                text("cannot write the video: ", space_advice(film.parent_path()), "; ffmpeg printed:", end.said));
  throw Error(Fault::data, ffmpeg.string() + " " + end.in_words());
}

}  // namespace

bool write_film(const fs::path& folder, const std::string& name, std::size_t count, int frames_per_second,
                const Common& common) {
  const fs::path ffmpeg = find_program("ffmpeg"), film = folder / (name + ".mp4");
  if (ffmpeg.empty()) {
    say(common, text("no ", film.string(), ": ffmpeg is not in PATH (apt-get install ffmpeg)"));
    return false;
  }
  const std::string pictures = without_places(fs::absolute(folder / name).string()) + "_%04d.png";
  try {
    commit_file(fs::absolute(film), [&](const fs::path& temp) {
      encode(ffmpeg,
             {"-f", "image2", "-pattern_type", "sequence", "-framerate", std::to_string(frames_per_second),
              "-start_number", "0", "-i", pictures, "-frames:v", std::to_string(count)},
             temp);
    });
  } catch (const Error& error) {
    if (error.fault() == Fault::write) throw;
    warn(text("no ", film.string(), ": ", error.what()));
    return false;
  }
  return true;
}

}  // namespace cloam
