// The program's and the library's version, as runs and files that are made name it.
#pragma once

namespace cloam {

constexpr char kVersion[] = "0.1.0";

}  // namespace cloam
