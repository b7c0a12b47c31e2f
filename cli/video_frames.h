// Photos out of a video, by ffmpeg: the sharpest frame of each part of it, upright and in the colours of ordinary
// screens.
#pragma once
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

namespace cloam {

/// What ffprobe says of the first video stream of a file.
struct Video {
  std::filesystem::path file;
  std::string codec;
  int width = 0, height = 0;                // as stored, in pixels
  double rate = 0;                          // mean frames a second; 0: the file does not say
  double seconds = 0;                       // 0: the file does not say, as of what a browser recorded
  int turn = 0;                             // degrees clockwise, from 0 to 359, by which a player turns it
  std::string transfer, primaries, matrix;  // in ffmpeg's words; "": the file does not say
  bool tone_maps = false;  // whether this ffmpeg has the filters that videos of a high dynamic range need
  /// "HLG" or "PQ" where the colours are of the high dynamic range; "" elsewhere.
  std::string high_range() const;
};

/// Fault::usage without ffmpeg and ffprobe; Fault::data for a file that is damaged or no video.
Video read_video(const std::filesystem::path& file);

/// In words: "hevc, 1920x1080, 30 frames/s, 12s; turned by 90 degrees, as the file says; HLG (HDR), tone mapped".
std::string in_words(const Video& video);

struct FrameWish {
  double fps = 2;  // parts a second
  int count = 0;   // parts in all, of equal length, instead; 0: by fps
};

/// Is told what begins, and how much of it is done, from 0 to 1.
struct FrameListener {
  std::function<void(const std::string& stage)> begin;
  std::function<void(double share)> draw;
};
/// How often it hears of what begins.
constexpr int kFrameStages = 2;

/// Files frame_000123.jpg, by the frame's number in the video, in `folder`, which must not exist and appears as a
/// whole. A part without a frame has none. The sharpest is the one with the largest mean Laplacian of its brightness,
/// at 1280 columns or fewer. Nothing once stop_signal is set. Fault::data for a video that is damaged or too short for
/// three parts, Fault::usage for more than 5000, Fault::write where the disk is full. Warns where a part of the video
/// is damaged.
void take_frames(const Video& video, const FrameWish& wish, const std::filesystem::path& folder,
                 const FrameListener& listener);

}  // namespace cloam
