// The name that was meant: for messages about words with a typing mistake.
#pragma once
#include <string>
#include <vector>

namespace cloam {

/// The name among `names` that is most like `wanted`, or "" if none is near: for "did you mean".
std::string nearest_name(const std::string& wanted, const std::vector<std::string>& names);
/// "; did you mean NAME?", or "".
std::string did_you_mean(const std::string& wanted, const std::vector<std::string>& names);

}  // namespace cloam
