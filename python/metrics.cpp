// Figures of images and points, as `cloam eval` and `cloam compare` have them.
#include "models/metrics/chamfer.h"
#include "models/metrics/lpips.h"
#include "models/metrics/psnr.h"
#include "models/metrics/ssim.h"
#include "python/bindings.h"
#include "runtime/error.h"
#include "runtime/ops.h"

namespace cloam {
namespace {

/// Bytes count as 0 to 255, floats are in [0,1].
Floats image_from(const py::array& given) {
  if (given.ndim() != 3) throw Error(Fault::usage, text("an image is [H,W,C], found ", given.ndim(), " axes"));
  const bool bytes = given.dtype().kind() == 'u' && given.itemsize() == 1;
  return floats_from(bytes ? py::array(given.attr("astype")("float32") / py::float_(255.0f)) : given, "an image");
}

std::span<const float> values_of(const Floats& array) { return {array.data(), static_cast<std::size_t>(array.size())}; }

void check_alike(const Floats& a, const Floats& b) {
  for (py::ssize_t axis = 0; axis < 3; ++axis)
    if (a.shape(axis) != b.shape(axis))
      throw Error(Fault::usage, text("images of ", a.shape(1), "x", a.shape(0), " and ", b.shape(1), "x", b.shape(0),
                                     " with ", a.shape(2), " and ", b.shape(2), " channels: want two of one size"));
}

double psnr_of(const py::array& a, const py::array& b) {
  const Floats x = image_from(a), y = image_from(b);
  check_alike(x, y);
  const Unlocked others;
  return psnr(values_of(x), values_of(y));
}

double ssim_of(const py::array& a, const py::array& b) {
  const Floats x = image_from(a), y = image_from(b);
  check_alike(x, y);
  const ImageShape shape{static_cast<int>(x.shape(0)), static_cast<int>(x.shape(1)), static_cast<int>(x.shape(2))};
  const Unlocked others;
  return ssim(values_of(x), values_of(y), shape);
}

/// [H,W,3] -> [1,3,H,W].
Tensor picture(const Floats& image) {
  if (image.shape(2) != 3) throw Error(Fault::usage, text("LPIPS is of 3 channels, found ", image.shape(2)));
  const Shape shape{image.shape(0), image.shape(1), 3};
  return unsqueeze(permute(from_bytes(image.data(), DType::f32, shape), {2, 0, 1}), 0);
}

double lpips_of(const Lpips& network, const py::array& a, const py::array& b) {
  const Floats x = image_from(a), y = image_from(b);
  check_alike(x, y);
  const Unlocked others;
  return static_cast<double>(network(picture(x), picture(y)).item());
}

double chamfer_of(const py::object& these, const py::object& those) {
  const Floats a = floats_from(these, "points"), b = floats_from(those, "points");
  for (const Floats* points : {&a, &b})
    if (points->ndim() != 2 || points->shape(1) != 3) throw Error(Fault::usage, "points are [N,3]");
  const Unlocked others;
  return chamfer(values_of(a), values_of(b)).symmetric();
}

}  // namespace

void add_metrics(py::module_& module) {
  module.def("psnr", &psnr_of, py::arg("a"), py::arg("b"),
             "Of two images [H,W,C], bytes or floats in [0,1], in dB; infinite where they are equal.");
  module.def("ssim", &ssim_of, py::arg("a"), py::arg("b"),
             "Structural similarity of two images [H,W,C], with the window of the Gaussian splatting papers.");
  module.def("chamfer", &chamfer_of, py::arg("a"), py::arg("b"),
             "The mean over a of the squared distance to the nearest point of b, plus the same the other way; [N,3], "
             "[M,3].");
  py::class_<Lpips>(module, "Lpips",
                    "LPIPS 0.1 with the weights that the files hold: \"BACKBONE,LINEAR\", or one file.")
      .def(py::init([](const std::string& files) {
             open_device();
             return lpips_named(files);
           }),
           py::arg("files"), py::call_guard<Unlocked>())
      .def_readonly("name", &Lpips::name)
      .def_property_readonly("published", &Lpips::published, "Whether its values are LPIPS.")
      .def("__call__", &lpips_of, py::arg("a"), py::arg("b"), "Of two images [H,W,3], bytes or floats in [0,1].");
}

}  // namespace cloam
