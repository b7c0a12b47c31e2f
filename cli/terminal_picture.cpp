// See terminal_picture.h.
#include "cli/terminal_picture.h"

#include <fmt/format.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <map>

#include "cli/page.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr int kCellWidth = 8;      // pixels of a character, where the terminal does not tell
constexpr int kOtherColumns = 80;  // where it does not tell its width

const std::map<std::string, TerminalKind> kKinds = {{"kitty", TerminalKind::kitty},
                                                    {"iterm", TerminalKind::iterm},
                                                    {"sixel", TerminalKind::sixel},
                                                    {"blocks", TerminalKind::blocks}};

std::string variable(const char* name) {
  const char* value = std::getenv(name);
  return value ? value : "";
}

bool holds(const std::string& where, const char* what) { return where.find(what) != std::string::npos; }

/// What the terminal says of itself. Within tmux and screen characters alone come through.
TerminalKind kind_of_terminal() {
  const std::string term = variable("TERM"), program = variable("TERM_PROGRAM"), colours = variable("COLORTERM");
  const bool wrapped = !variable("TMUX").empty() || term.starts_with("screen") || term.starts_with("tmux");
  if (!wrapped) {
    if (!variable("KITTY_WINDOW_ID").empty() || holds(term, "kitty") || holds(term, "ghostty"))
      return TerminalKind::kitty;
    if (program == "iTerm.app" || program == "WezTerm" || program == "mintty") return TerminalKind::iterm;
    if (holds(term, "sixel") || term.starts_with("foot") || term.starts_with("mlterm")) return TerminalKind::sixel;
  }
  const bool coloured = holds(colours, "truecolor") || holds(colours, "24bit") || holds(term, "direct");
  return coloured ? TerminalKind::blocks : TerminalKind::none;
}

struct TerminalSize {
  int columns, cell_width;
};

TerminalSize terminal_size() {
  winsize size{};
  if (ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) != 0 || size.ws_col == 0) return {kOtherColumns, kCellWidth};
  const int cell = size.ws_xpixel / size.ws_col;
  return {size.ws_col, cell > 0 ? cell : kCellWidth};
}

/// RGB, no wider than that.
Image fitted(const Image& image, int width) {
  const std::vector<std::uint8_t> rgba = as_rgba(image);
  Image rgb{image.width, image.height, 3, {}};
  for (std::size_t i = 0; i < rgba.size(); i += 4)
    for (std::size_t c = 0; c < 3; ++c)
      rgb.pixels.push_back(
          static_cast<std::uint8_t>((rgba[i + c] * rgba[i + 3] + 255 * (255 - rgba[i + 3]) + 127) / 255));
  if (rgb.width <= width) return rgb;
  return resized(rgb, width, std::max(1, rgb.height * width / rgb.width));
}

/// Raw pixels in pieces of at most 4,096 digits (sw.kovidgoyal.net/kitty/graphics-protocol).
std::string as_kitty(const Image& image) {
  constexpr std::size_t kPiece = 4096;
  const std::string digits = base64(image.pixels);
  std::string out;
  for (std::size_t at = 0; at < digits.size(); at += kPiece) {
    const std::string first =
        at == 0 ? fmt::format("a=T,f=24,s={},v={},q=2,", image.width, image.height) : std::string();
    const int more = at + kPiece < digits.size();
    out += fmt::format("\033_G{}m={};{}\033\\", first, more, digits.substr(at, kPiece));
  }
  return out + "\n";
}

/// A file within the text (iterm2.com/documentation-images.html).
std::string as_iterm(const Image& image) {
  const std::vector<std::uint8_t> file = jpeg_bytes(image, 95);
  return fmt::format("\033]1337;File=inline=1;size={};width={}px;height={}px:{}\a\n", file.size(), image.width,
                     image.height, base64(file));
}

/// The nearest of the levels 0, 20, ... 100 % after what the pixels before left over (Floyd and Steinberg 1976).
std::vector<std::uint8_t> dithered(const Image& image) {
  const auto width = static_cast<std::size_t>(image.width), height = static_cast<std::size_t>(image.height);
  std::vector<float> wanted(image.pixels.begin(), image.pixels.end());
  std::vector<std::uint8_t> colours(width * height);
  for (std::size_t y = 0; y < height; ++y)
    for (std::size_t x = 0; x < width; ++x)
      for (std::size_t c = 0; c < 3; ++c) {
        const std::size_t at = 3 * (y * width + x) + c;
        const int level = std::clamp(static_cast<int>(std::lround(wanted[at] / 51)), 0, 5);
        const float left = wanted[at] - 51.f * static_cast<float>(level);
        colours[y * width + x] = static_cast<std::uint8_t>(colours[y * width + x] * (c > 0 ? 6 : 1) + level);
        if (x + 1 < width) wanted[at + 3] += left * 7 / 16;
        if (y + 1 < height && x > 0) wanted[at + 3 * (width - 1)] += left * 3 / 16;
        if (y + 1 < height) wanted[at + 3 * width] += left * 5 / 16;
        if (y + 1 < height && x + 1 < width) wanted[at + 3 * (width + 1)] += left * 1 / 16;
      }
  return colours;
}

/// One colour of a band of six rows: a character a column, repeats counted.
std::string sixels(const std::vector<std::uint8_t>& bits) {
  std::string out;
  for (std::size_t x = 0; x < bits.size();) {
    std::size_t end = x;
    while (end < bits.size() && bits[end] == bits[x]) ++end;
    const std::string letter(1, static_cast<char>('?' + bits[x]));
    if (end - x > 3)
      out += fmt::format("!{}{}", end - x, letter);
    else
      for (std::size_t i = x; i < end; ++i) out += letter;
    x = end;
  }
  return out;
}

/// 216 colours (vt100.net/docs/vt3xx-gp/chapter14.html).
std::string as_sixel(const Image& image) {
  constexpr int kColours = 216;
  const std::vector<std::uint8_t> colours = dithered(image);
  const auto width = static_cast<std::size_t>(image.width);
  std::string out = fmt::format("\033P0;1q\"1;1;{};{}", image.width, image.height);
  for (int colour = 0; colour < kColours; ++colour)
    out += fmt::format("#{};2;{};{};{}", colour, colour / 36 * 20, colour / 6 % 6 * 20, colour % 6 * 20);
  for (int top = 0; top < image.height; top += 6) {
    std::map<int, std::vector<std::uint8_t>> band;  // by colour
    for (int row = top; row < std::min(top + 6, image.height); ++row)
      for (std::size_t x = 0; x < width; ++x) {
        auto& bits = band[colours[static_cast<std::size_t>(row) * width + x]];
        bits.resize(width);
        bits[x] = static_cast<std::uint8_t>(bits[x] | 1 << (row - top));
      }
    for (const auto& [colour, bits] : band) out += fmt::format("#{}{}$", colour, sixels(bits));
    out += "-";
  }
  return out + "\033\\\n";
}

/// Upper half blocks: the upper pixel in the colour of the letter, the lower one in that behind it.
std::string as_blocks(const Image& image) {
  const auto colour = [&](int x, int y) {
    const auto* rgb = &image.pixels[3 * (static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width) +
                                         static_cast<std::size_t>(x))];
    return fmt::format("{};{};{}", rgb[0], rgb[1], rgb[2]);
  };
  std::string out;
  for (int y = 0; y < image.height; y += 2) {
    for (int x = 0; x < image.width; ++x) {
      const std::string below = y + 1 < image.height ? "\033[48;2;" + colour(x, y + 1) + "m" : "\033[49m";
      out += "\033[38;2;" + colour(x, y) + "m" + below + "\u2580";
    }
    out += "\033[0m\n";
  }
  return out;
}

}  // namespace

void add_show(const Options& add, std::string& show) {
  std::vector<std::string> names = {"auto"};
  for (const auto& [name, kind] : kKinds) names.push_back(name);
  add.flag_or_word("--show", "auto", show, "Also show the picture in the terminal; --show=KIND: " + joined(names),
                   one_of(names));
}

void show_picture(const std::string& show, const fs::path& file, const Common& common) {
  if (show.empty()) return;
  if (common.json) return say(common, "--show: with --json, stdout is for programs; nothing is shown there");
  const bool chosen = show != "auto";
  if (!chosen && !isatty(STDOUT_FILENO)) return say(common, "--show: stdout is not a terminal; nothing is shown there");
  const TerminalKind kind = chosen ? kKinds.at(show) : kind_of_terminal();
  if (kind == TerminalKind::none)
    return say(common,
               "--show: this terminal does not say that it can show pictures (TERM, TERM_PROGRAM, COLORTERM)\n  fix: "
               "--show=blocks, --show=kitty, --show=iterm or --show=sixel, whichever it knows");
  const TerminalSize size = terminal_size();
  const int width = kind == TerminalKind::blocks ? size.columns : size.columns * size.cell_width;
  const Image image = fitted(read_image(file), width);
  switch (kind) {
    case TerminalKind::kitty:
      return put(as_kitty(image));
    case TerminalKind::iterm:
      return put(as_iterm(image));
    case TerminalKind::sixel:
      return put(as_sixel(image));
    default:
      return put(as_blocks(image));
  }
}

}  // namespace cloam
