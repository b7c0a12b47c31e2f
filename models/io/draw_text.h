// Words in pictures, by OpenImageIO and FreeType. The font is the system's: DejaVu Sans (fonts-dejavu-core).
#pragma once
#include <string>

#include "models/io/image.h"

namespace cloam {

/// Whether the font is there. Without it the other two do nothing.
bool can_draw_text();

/// Pixels from the left end of the line to its right end.
int text_width(const std::string& line, int height);

/// In black on an RGB image. What lies outside of the image is cut off.
void draw_text(Image& image, const std::string& line, int left, int baseline, int height);

}  // namespace cloam
