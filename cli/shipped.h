// The runs that come with the program: networks of stage 1, and a diffusion of their codes.
#pragma once
#include <filesystem>
#include <string>

namespace cloam {

/// The word that names them in the place of a run folder.
constexpr char kShipped[] = "shipped";

/// The shipped run if `given` is "shipped", else `given`. Fault::usage where the program was installed without them.
std::string networks_named(const std::string& given);
std::string prior_named(const std::string& given);
bool ships_prior();

}  // namespace cloam
