// GIF through OpenImageIO: each frame is one more subimage.
#include "models/io/gif.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

#include <span>

#include "models/io/commit.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr char kTrailer = 0x3B;

void check(const std::vector<Image>& frames) {
  if (frames.empty()) throw Error(Fault::internal, "a GIF of no frames");
  for (const Image& frame : frames) {
    const bool fits = frame.channels == 3 && frame.width == frames[0].width && frame.height == frames[0].height;
    if (!fits) throw Error(Fault::internal, "a GIF wants RGB frames of one size");
  }
}

bool encode(OIIO::ImageOutput& output, const std::vector<Image>& frames, int rate) {
  OIIO::ImageSpec spec(frames[0].width, frames[0].height, 3, OIIO::TypeDesc::UINT8);
  spec.attribute("oiio:Movie", 1);
  spec.attribute("gif:LoopCount", 0);
  const int fraction[2] = {rate, 1};
  spec.attribute("FramesPerSecond", OIIO::TypeRational, fraction);
  auto mode = OIIO::ImageOutput::Create;
  for (const Image& frame : frames) {
    if (!output.open("in memory", spec, mode)) return false;
    if (!output.write_image(OIIO::TypeDesc::UINT8, frame.pixels.data())) return false;
    mode = OIIO::ImageOutput::AppendSubimage;
  }
  return output.close();
}

/// A comment extension (GIF89a, section 24) in the place of the trailer, and the trailer again.
void add_comment(std::vector<unsigned char>& gif, const std::string& comment) {
  constexpr std::size_t kBlock = 255;
  std::string bytes = "\x21\xFE";
  for (std::size_t at = 0; at < comment.size(); at += kBlock) {
    const std::string block = comment.substr(at, kBlock);
    bytes += static_cast<char>(block.size()) + block;
  }
  bytes += {'\0', kTrailer};
  gif.pop_back();
  gif.insert(gif.end(), bytes.begin(), bytes.end());
}

}  // namespace

void write_gif(const std::filesystem::path& path, const std::vector<Image>& frames, int frames_per_second,
               const std::string& comment) {
  check(frames);
  OIIO::Filesystem::IOVecOutput memory;  // as image.cpp does
  const auto output = OIIO::ImageOutput::create("gif");
  const bool done = output && output->set_ioproxy(&memory) && encode(*output, frames, frames_per_second) &&
                    !memory.buffer().empty() && memory.buffer().back() == kTrailer;
  if (!done) {
    throw Error(Fault::write,
                text(path.string(), ": cannot be encoded: ", output ? output->geterror() : OIIO::geterror()));
  }
  if (!comment.empty()) add_comment(memory.buffer(), comment);
  commit_bytes(path, std::as_bytes(std::span(memory.buffer())));
}

}  // namespace cloam
