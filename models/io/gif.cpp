// GIF through OpenImageIO: each frame is one more subimage.
#include "models/io/gif.h"

#include <OpenImageIO/imageio.h>

#include <fstream>

#include "models/io/commit.h"
#include "runtime/error.h"

namespace cloam {
namespace {

void check(const std::vector<Image>& frames) {
  if (frames.empty()) throw Error(Fault::internal, "a GIF of no frames");
  for (const Image& frame : frames) {
    const bool fits = frame.channels == 3 && frame.width == frames[0].width && frame.height == frames[0].height;
    if (!fits) throw Error(Fault::internal, "a GIF wants RGB frames of one size");
  }
}

bool write_frames(OIIO::ImageOutput& output, const std::string& name, const std::vector<Image>& frames, int rate) {
  OIIO::ImageSpec spec(frames[0].width, frames[0].height, 3, OIIO::TypeDesc::UINT8);
  spec.attribute("oiio:Movie", 1);
  spec.attribute("gif:LoopCount", 0);
  const int fraction[2] = {rate, 1};
  spec.attribute("FramesPerSecond", OIIO::TypeRational, fraction);
  auto mode = OIIO::ImageOutput::Create;
  for (const Image& frame : frames) {
    if (!output.open(name, spec, mode)) return false;
    if (!output.write_image(OIIO::TypeDesc::UINT8, frame.pixels.data())) return false;
    mode = OIIO::ImageOutput::AppendSubimage;
  }
  return output.close();
}

/// A comment extension (GIF89a, section 24) in the place of the trailer, and the trailer again.
bool add_comment(const std::filesystem::path& path, const std::string& comment) {
  constexpr char kTrailer = 0x3B;
  constexpr std::size_t kBlock = 255;
  std::fstream file(path, std::ios::binary | std::ios::in | std::ios::out);
  file.seekg(-1, std::ios::end);
  if (file.get() != kTrailer) return false;
  std::string bytes = "\x21\xFE";
  for (std::size_t at = 0; at < comment.size(); at += kBlock) {
    const std::string block = comment.substr(at, kBlock);
    bytes += static_cast<char>(block.size()) + block;
  }
  bytes += {'\0', kTrailer};
  file.seekp(-1, std::ios::end);
  file << bytes << std::flush;
  return file.good();
}

}  // namespace

void write_gif(const std::filesystem::path& path, const std::vector<Image>& frames, int frames_per_second,
               const std::string& comment) {
  check(frames);
  commit_file(path, [&](const std::filesystem::path& temp) {
    const auto output = OIIO::ImageOutput::create("gif");
    if (output && write_frames(*output, temp.string(), frames, frames_per_second)) {
      if (comment.empty() || add_comment(temp, comment)) return;
      throw Error(Fault::write, text(path.string(), ": its comment cannot be written"));
    }
    throw Error(Fault::write,
                text(path.string(), ": cannot be written: ", output ? output->geterror() : OIIO::geterror()));
  });
}

}  // namespace cloam
