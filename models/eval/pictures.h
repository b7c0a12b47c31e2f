// Pictures for people: renders as 8-bit images, comparisons, contact sheets.
#pragma once
#include <vector>

#include "models/io/image.h"
#include "models/scene/pixels.h"
#include "models/street/street.h"

namespace cloam {

/// A photo as metrics see it: [H,W,3] in [0,1], composited on white where it is transparent (the convention of the
/// NeRF-synthetic scenes).
std::vector<float> on_white(const FramePixels& frame);

/// The absolute difference of two [H,W,3], four times as bright so that small errors show.
Image error_image(const std::vector<float>& a, const std::vector<float>& b, int width, int height);

/// Two lines below a picture of a sheet, cut to its width.
struct Caption {
  std::string first, second;
};

/// RGB images in rows of `columns`, with a gap of white; cells have the size of the largest. captions: one an image, or
/// none; they are left out where there is no font (draw_text.h).
Image contact_sheet(const std::vector<Image>& images, int columns, const std::vector<Caption>& captions = {});

/// The images of a sheet of one row without captions, so many of equal size. Fault::data for another picture.
std::vector<Image> images_of_sheet(const Image& sheet, int columns);

/// An asset of that size alone on white, from its front left and a little above.
Image three_quarter_picture(Street& street, const AssetName& appearance, const Eigen::Vector3d& size, int pixels);

/// `count` pictures of pixels x pixels all around an asset of that size, alone on white, from its front
/// counter-clockwise (orbit.h: turntable_poses).
std::vector<Image> turntable(Street& street, const AssetName& appearance, const Eigen::Vector3d& size, int count,
                             int pixels);

/// A file name (no extension) for each frame, from its image path with "/" as "_"; all different.
std::vector<std::string> file_names(const Scene& scene, const std::vector<std::size_t>& frames);

/// What a picture of the view knows as float layers of one EXR: R G B (composited, hence A = 1), depth.Z along the ray
/// and Z along the optical axis in scene units (0: nothing), opacity.A, and N.X N.Y N.Z, the normal of the surface that
/// the depths make in the world's axes, towards the camera (0: none).
void write_picture_exr(const std::filesystem::path& path, const Picture& picture, const View& view);

}  // namespace cloam
