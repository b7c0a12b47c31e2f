// Pictures in a terminal (--show).
#pragma once
#include <filesystem>
#include <string>

#include "cli/options.h"
#include "models/io/image.h"

namespace cloam {

/// How a terminal is sent a picture: the graphics protocols of kitty and of iTerm2, sixel (DEC's VT340), or characters
/// of two pixels each in 24-bit colours.
enum class TerminalKind { none, kitty, iterm, sixel, blocks };

/// --show and --show=KIND. What is typed goes to `show`: "" (not asked for), "auto" or a kind.
void add_show(const Options& add, std::string& show);

/// Draws the picture of a file on stdout, as wide as the terminal at most. auto: as its environment says that it can;
/// where stdout is no terminal, or can show nothing, a line on stderr says so. Nothing where show is "".
/// Fault::data if the file cannot be read.
void show_picture(const std::string& show, const std::filesystem::path& file, const Common& common);

}  // namespace cloam
