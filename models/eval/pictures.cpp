// See pictures.h.
#include "models/eval/pictures.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "models/eval/geometry_pictures.h"
#include "models/io/draw_text.h"
#include "models/scene/orbit.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr int kGap = 4;
constexpr int kLetters = 12, kLine = 15, kBelow = 4;  // heights of letters, of a line, and from its baseline to its end
constexpr float kErrorGain = 4;

void paste(Image& sheet, const Image& image, int left, int top) {
  for (int row = 0; row < image.height; ++row) {
    const auto* from = image.pixels.data() + std::size_t(row) * image.width * 3;
    std::copy(from, from + std::size_t(image.width) * 3,
              sheet.pixels.data() + (std::size_t(top + row) * sheet.width + left) * 3);
  }
}

/// The beginning of the line that fits.
std::string shortened(const std::string& line, int width) {
  if (text_width(line, kLetters) <= width) return line;
  std::string cut = line;
  while (!cut.empty() && text_width(cut + "...", kLetters) > width) cut.pop_back();
  return cut + "...";
}

void write_caption(Image& sheet, const Caption& caption, int left, int top, int width) {
  draw_text(sheet, shortened(caption.first, width), left, top + kLine - kBelow, kLetters);
  draw_text(sheet, shortened(caption.second, width), left, top + 2 * kLine - kBelow, kLetters);
}

std::string flat_name(const std::string& image) {
  std::string name = std::filesystem::path(image).lexically_normal().replace_extension().generic_string();
  std::replace(name.begin(), name.end(), '/', '_');
  return name.empty() || name[0] == '.' ? "view" + name : name;
}

}  // namespace

std::vector<float> on_white(const FramePixels& frame) {
  const std::size_t count = std::size_t(frame.width) * frame.height;
  std::vector<float> rgb(3 * count);
  for (std::size_t i = 0; i < count; ++i) {
    const float alpha = static_cast<float>(frame.rgba[4 * i + 3]) / 255;
    for (std::size_t c = 0; c < 3; ++c) {
      rgb[3 * i + c] = static_cast<float>(frame.rgba[4 * i + c]) / 255 * alpha + (1 - alpha);
    }
  }
  return rgb;
}

Image error_image(const std::vector<float>& a, const std::vector<float>& b, int width, int height) {
  std::vector<float> error(a.size());
  for (std::size_t i = 0; i < a.size(); ++i) error[i] = kErrorGain * std::abs(a[i] - b[i]);
  return to_image(error, width, height);
}

Image contact_sheet(const std::vector<Image>& images, int columns, const std::vector<Caption>& captions) {
  int width = 0, height = 0;
  for (const Image& image : images) {
    width = std::max(width, image.width);
    height = std::max(height, image.height);
  }
  const bool has_captions = !captions.empty() && can_draw_text();
  const int cell = height + (has_captions ? 2 * kLine : 0);
  const int count = static_cast<int>(images.size()), wide = std::min(columns, count);
  const int rows = (count + columns - 1) / columns;
  Image sheet{wide * (width + kGap) - kGap, rows * (cell + kGap) - kGap, 3, {}};
  sheet.pixels.assign(std::size_t(sheet.width) * sheet.height * 3, 255);
  for (int i = 0; i < count; ++i) {
    const int left = i % columns * (width + kGap), top = i / columns * (cell + kGap);
    paste(sheet, images[static_cast<std::size_t>(i)], left, top);
    if (has_captions) write_caption(sheet, captions.at(static_cast<std::size_t>(i)), left, top + height, width);
  }
  return sheet;
}

std::vector<Image> images_of_sheet(const Image& sheet, int columns) {
  const int width = (sheet.width + kGap) / columns - kGap;
  if (width < 1 || columns * (width + kGap) - kGap != sheet.width || sheet.channels != 3)
    throw Error(Fault::data, text("a picture of ", sheet.width, "x", sheet.height, " is no sheet of ", columns));
  std::vector<Image> images;
  for (int column = 0; column < columns; ++column) {
    Image image{width, sheet.height, 3, {}};
    for (int y = 0; y < sheet.height; ++y) {
      const auto row = sheet.pixels.begin() + (std::ptrdiff_t{y} * sheet.width + column * (width + kGap)) * 3;
      image.pixels.insert(image.pixels.end(), row, row + std::ptrdiff_t{width} * 3);
    }
    images.push_back(std::move(image));
  }
  return images;
}

Image three_quarter_picture(Street& street, const AssetName& appearance, const Eigen::Vector3d& size, int pixels) {
  const Camera camera = turntable_camera(pixels, pixels);
  const Picture picture = street.render_asset(appearance, camera, three_quarter_pose(size, camera));
  return to_image(picture.rgb, picture.width, picture.height);
}

std::vector<Image> turntable(Street& street, const AssetName& appearance, const Eigen::Vector3d& size, int count,
                             int pixels) {
  const Camera camera = turntable_camera(pixels, pixels);
  std::vector<Image> images;
  for (const auto& pose : turntable_poses(size, camera, count)) {
    const Picture picture = street.render_asset(appearance, camera, pose);
    images.push_back(to_image(picture.rgb, picture.width, picture.height));
  }
  return images;
}

std::vector<std::string> file_names(const Scene& scene, const std::vector<std::size_t>& frames) {
  std::vector<std::string> names;
  std::set<std::string> taken;
  for (const std::size_t index : frames) {
    const std::string base = flat_name(scene.frames[index].image);
    std::string name = base;
    for (int copy = 2; !taken.insert(name).second; ++copy) name = base + "_" + std::to_string(copy);
    names.push_back(name);
  }
  return names;
}

void write_picture_exr(const std::filesystem::path& path, const Picture& picture, const View& view) {
  const std::size_t count = std::size_t(picture.width) * picture.height;
  const std::vector<float> directions = pixel_directions(view.camera), normals = surface_normals(picture, view.camera);
  const Eigen::Matrix3d world_from_camera = view.world_from_camera.topLeftCorner<3, 3>();
  std::vector<float> planes(7 * count);  // R G B, N, Z
  for (std::size_t i = 0; i < count; ++i) {
    const Eigen::Vector3d normal =
        world_from_camera * Eigen::Map<const Eigen::Vector3f>(&normals[3 * i]).cast<double>();
    const Eigen::Vector3d way = Eigen::Map<const Eigen::Vector3f>(&directions[3 * i]).cast<double>();
    for (std::size_t c = 0; c < 3; ++c) {
      planes[c * count + i] = picture.rgb[3 * i + c];
      planes[(3 + c) * count + i] = static_cast<float>(normal[static_cast<Eigen::Index>(c)]);
    }
    planes[6 * count + i] = picture.depth[i] * static_cast<float>(way.z() / way.norm());
  }
  const std::vector<float> opaque(count, 1.f);
  const auto plane = [&](std::size_t index) { return planes.data() + index * count; };
  write_exr(path, picture.width, picture.height,
            {{"R", plane(0)},
             {"G", plane(1)},
             {"B", plane(2)},
             {"A", opaque.data()},
             {"Z", plane(6)},
             {"N.X", plane(3)},
             {"N.Y", plane(4)},
             {"N.Z", plane(5)},
             {"depth.Z", picture.depth.data()},
             {"opacity.A", picture.opacity.data()}});
}

}  // namespace cloam
