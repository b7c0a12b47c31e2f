// The prior that comes with the program: whoever changes what it needs trains it again (script/prior).
#include <doctest/doctest.h>

#include <cmath>

#include "models/io/image.h"
#include "models/io/safetensors.h"
#include "tests/cli/process.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

/// What is pinned of an asset: the mean and the deviation of its code, its box, and of its picture from the side the
/// share that is not white and the mean colour of that.
struct Pinned {
  double mean, deviation, length, covered, red, green, blue;
};

std::uintmax_t bytes_in(const fs::path& folder) {
  std::uintmax_t bytes = 0;
  for (const auto& entry : fs::recursive_directory_iterator(folder))
    if (entry.is_regular_file()) bytes += entry.file_size();
  return bytes;
}

Pinned found_of(const fs::path& folder, std::size_t asset) {
  const TensorMap latents = read_safetensors(folder / "latents.safetensors").tensors;
  const NamedTensor& codes = latents.at("latents");
  const auto numbers = static_cast<std::size_t>(codes.shape[1] * codes.shape[2] * codes.shape[3]);
  const auto* values = reinterpret_cast<const float*>(codes.data.data()) + asset * numbers;
  const auto* sizes = reinterpret_cast<const float*>(latents.at("sizes").data.data()) + 3 * asset;
  Pinned found{0, 0, double{sizes[1]}, 0, 0, 0, 0};
  const auto count = static_cast<double>(numbers);
  for (std::size_t i = 0; i < numbers; ++i) found.mean += double{values[i]} / count;
  for (std::size_t i = 0; i < numbers; ++i) found.deviation += std::pow(double{values[i]} - found.mean, 2) / count;
  found.deviation = std::sqrt(found.deviation);
  const Image image = read_image(folder / "pictures" / ("asset_00" + std::to_string(asset) + "_0000.png"));
  const auto channels = static_cast<std::size_t>(image.channels);
  double shown = 0;
  for (std::size_t i = 0; i < image.pixels.size(); i += channels) {
    if (image.pixels[i] + image.pixels[i + 1] + image.pixels[i + 2] > 3 * 240) continue;
    found.red += image.pixels[i], found.green += image.pixels[i + 1], found.blue += image.pixels[i + 2];
    ++shown;
  }
  found.covered = shown / (image.width * image.height);
  found.red /= shown, found.green /= shown, found.blue /= shown;
  return found;
}

}  // namespace

TEST_CASE("the shipped prior generates what it did when it was shipped, and is small and of no machine") {
  const fs::path shipped = fs::path(CLOAM_SOURCE) / "shipped", out = scratch() / "of-shipped";
  CHECK(bytes_in(shipped) < 12'000'000);
  for (const char* file : {"networks/run.json", "assets/run.json", "networks/scene.json"})
    CHECK_FALSE(contains(content_of(shipped / file), "\"/"));  // no path from the root of a machine
  const Outcome made = cloam_with({"generate", "-n", "2", "--class", "Car", "--time", "day", "--seed", "7", "-o",
                                   out.string(), "--pictures", "--frames", "4", "--size", "64", "--no-meshes", "-q"});
  REQUIRE_MESSAGE(made.code == 0, made.err);
  const Pinned pinned[] = {{0.02467, 0.32268, 4.9412, 0.2144, 137.52, 134.62, 119.39},
                           {0.00142, 0.28375, 4.8628, 0.2190, 126.73, 124.71, 112.86}};
  for (std::size_t asset = 0; asset < 2; ++asset) {
    const Pinned want = pinned[asset], found = found_of(out, asset);
    CAPTURE(asset);
    CHECK(std::abs(found.mean - want.mean) < 2e-3);
    CHECK(std::abs(found.deviation - want.deviation) < 2e-3);
    CHECK(std::abs(found.length - want.length) < 1e-2);
    CHECK(std::abs(found.covered - want.covered) < 0.01);
    CHECK(std::abs(found.red - want.red) < 2);
    CHECK(std::abs(found.green - want.green) < 2);
    CHECK(std::abs(found.blue - want.blue) < 2);
  }
}
