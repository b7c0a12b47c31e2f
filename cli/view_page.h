// The viewer's page, one HTML file that the build puts into the program (cmake/viewer_page.cmake).
#pragma once
#include <string>

namespace cloam {

std::string viewer_page();

}  // namespace cloam
