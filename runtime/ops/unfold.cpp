// Windows of images laid out by tap: what makes matrix products of convolutions.
#include "runtime/ops.h"
#include "runtime/ops/share.h"

namespace cloam {
namespace {

const Registered kUnfoldKernels[] = {Registered("unfold"), Registered("fold")};

/// x [A,B,H,W,N], windows [A,R*S,B,P,Q,N].
struct Unfold final : Op {
  Unfold(bool back, const Shape& of, const Window& w) : adjoint(back), image(of), window(w) {}
  const char* name() const override { return adjoint ? "fold" : "unfold"; }
  Shape windows() const {
    return {image[0],
            window.height * window.width,
            image[1],
            window.places(image[2], window.height),
            window.places(image[3], window.width),
            image[4]};
  }
  void run(const Tensors& in, Tensor& out) const override {
    const Shape w = windows();
    if (out.numel() == 0) return;
    if (!is_cpu_class()) {
      const char* const each = adjoint ? "fold_each" : "unfold_each";
      return launch(kernel("unfold", each), each, elements(out.numel()), in[0], out, out.numel(), w[2], image[2],
                    image[3], w[5], window.height, window.width, w[3], w[4], window.stride, window.pad);
    }
    const int64_t images = w[0] * w[2], rows = adjoint ? images : images * w[1];
    const WorkShare work = share(rows, 4096 / ((adjoint ? in[0] : out).numel() / rows + 1));
    launch(kernel("unfold", name()), name(), work.range, in[0], out, rows, w[2], image[2], image[3], w[5],
           window.height, window.width, w[3], w[4], window.stride, window.pad, work.chunk);
  }
  Tensors vjp(const Tensors&, const Tensor&, const Tensor& g) const override { return {apply(!adjoint, g)}; }
  Tensor apply(bool back, const Tensor& x) const {
    return make(std::make_shared<Unfold>(back, image, window), back ? image : windows(), {x});
  }
  bool adjoint;
  Shape image;
  Window window;
};

Unfold checked(const char* op, const Tensor& x, const Shape& image, const Window& w) {
  const auto fits = [&](int64_t size, int64_t taps) { return taps >= 1 && size + 2 * w.pad >= taps; };
  if (x.dtype() != DType::f32 || !fits(image[2], w.height) || !fits(image[3], w.width) || w.stride < 1 || w.pad < 0)
    throw Error(Fault::internal,
                text("[", op, "] ", to_string(x.shape()), " ", name_of(x.dtype()), ", images ", image[2], "x", image[3],
                     ", window ", w.height, "x", w.width, ", stride ", w.stride, ", pad ", w.pad,
                     ": want float32, stride from 1, pad from 0, a window that fits the padded image"));
  return {false, image, w};
}

}  // namespace

Tensor unfold(const Tensor& x, const Window& window) {
  match("unfold", {{"x", x, "A B H W N"}});
  return checked("unfold", x, x.shape(), window).apply(false, x);
}

Tensor fold(const Tensor& windows, const Window& window, int64_t height, int64_t width) {
  const Dims d = match("fold", {{"windows", windows, "A taps B P Q N"}});
  const Unfold op = checked("fold", windows, {d["A"], d["B"], height, width, d["N"]}, window);
  if (!(op.windows() == windows.shape()))
    throw Error(Fault::internal, text("[fold] windows ", to_string(windows.shape()), ", want ", to_string(op.windows()),
                                      " for images ", height, "x", width));
  return op.apply(true, windows);
}

}  // namespace cloam
