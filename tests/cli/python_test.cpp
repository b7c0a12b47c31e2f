// Python's module, installed into a clean prefix: it computes what NumPy computes, and makes the bytes that the program
// makes.
#include <doctest/doctest.h>

#include <sstream>

#include "models/io/image.h"
#include "tests/cli/python_program.h"
#include "tests/cli/small_street.h"

#ifdef CLOAM_PYTHON

using namespace cloam;
using namespace python_program;

namespace {

void must(const Words& words) {
  const Outcome outcome = cloam_with(words);
  REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
}

std::string checkpoint_in(const fs::path& run) {
  std::string name = content_of(run / "ckpt" / "latest.txt");
  name.erase(name.find_last_not_of('\n') + 1);
  return content_of(run / "ckpt" / name);
}

constexpr char kRenderAll[] = R"(
run = cloam.load(sys.argv[1])
for view in run.views("test"):
    open(sys.argv[2] + "/" + view.name + ".raw", "wb").write(run.render(view).image.tobytes())
)";

/// How many pictures are pixel for pixel those that `render` makes of the run.
int equal_pictures(const fs::path& run, const fs::path& raw) {
  fs::create_directories(raw);
  printed(kRenderAll, {run.string(), raw.string()});
  const fs::path pictures = raw / "pictures";
  must({"render", run.string(), "-o", pictures.string()});
  int equal = 0;
  for (const auto& entry : fs::directory_iterator(pictures)) {
    const Image image = read_image(entry.path());
    const std::string pixels(image.pixels.begin(), image.pixels.end());
    CHECK(pixels == content_of(raw / (entry.path().stem().string() + ".raw")));
    equal++;
  }
  return equal;
}

}  // namespace

TEST_CASE("python: tensors are NumPy's arrays and back, and ops and gradients are NumPy's") {
  CHECK(printed(R"(
rng = np.random.default_rng(1)
for dtype in ("float32", "float16", "int32", "uint32", "uint8"):
    a = (100 * rng.random((3, 5))).astype(dtype)
    t = cloam.tensor(a)
    assert t.shape == (3, 5) and t.dtype == np.dtype(dtype) and (t.numpy() == a).all(), dtype
    assert (t.numpy(copy=True) == a).all() and (np.asarray(t) == a).all()
    assert (cloam.tensor(a[::-1, 1:]).numpy() == a[::-1, 1:]).all()  # any strides
assert cloam.tensor(np.float64([0.1])).numpy()[0] == np.float32(0.1)
a, b = rng.random((4, 3)).astype("f4"), rng.random((3, 4)).astype("f4")
x, y = cloam.tensor(a), cloam.tensor(b)
close = lambda t, want: np.testing.assert_allclose(t.numpy(), want, rtol=2e-5, atol=1e-6)
close(x @ y, a @ b)
close(a.T + y, a.T + b)  # an array on the left
close(2 - x / 3 + x ** 2, 2 - a / 3 + a ** 2)
close(1 / x, 1 / a)
close(-x[1:, ::2], -a[1:, ::2]); close(x[-1], a[-1]); close(x[..., 0], a[..., 0]); close(x[2, 1], a[2, 1])
close(x.T, a.T); close(x.reshape(2, -1), a.reshape(2, -1)); close(x.reshape((12,)), a.reshape(12))
close(cloam.sum(x, axis=0), a.sum(0)); close(cloam.mean(x, axis=(0, 1), keepdims=True), a.mean(keepdims=True))
close(cloam.max(x, axis=-1), a.max(-1)); close(cloam.softmax(x, 1), np.exp(a) / np.exp(a).sum(1, keepdims=True))
close(cloam.where(x < 0.5, x, 0.5), np.minimum(a, 0.5)); close(cloam.clamp(x, 0.2, 0.4), a.clip(0.2, 0.4))
close(cloam.concat([x, x], 0), np.concatenate([a, a])); close(cloam.cumsum(x, 1), a.cumsum(1))
keys, order = cloam.sort(x.reshape(12))
close(keys, np.sort(a.ravel())); assert (order.numpy() == np.argsort(a.ravel(), kind="stable")).all()
p = cloam.parameter(a)
first, = cloam.grad(cloam.sum(p * p * p), [p])
close(first, 3 * a * a)
close(cloam.grad(cloam.sum(first), [p])[0], 6 * a)  # again
close(cloam.grad(p * 2, [p], g=x)[0], 2 * a)
before = p.numpy()
cloam.Adam([p], learning_rate=0.1).step([cloam.ones(p.shape)])
close(p, a - 0.1); assert (before == a).all()  # a parameter's array is a copy
cloam.assign(p, b.T)
close(p, b.T)
print("well")
)") == "well\n");
}

TEST_CASE("python: numbers, powers, quotients and comparisons are NumPy's") {
  CHECK(printed(R"(
a = np.array([[-2, -0.5, 3], [1.5, -1, 0.25]], np.float32)
t, whole = cloam.tensor(a), cloam.tensor([1, 2, -3])
close = lambda t, want: np.testing.assert_allclose(t.numpy(), want, rtol=1e-5)
for n in (0, 1, 2, 3, 7, -1, -2, 4.0, np.int64(2), np.float32(3)):
    close(t ** n, a ** n)
p = cloam.parameter(a)
for n in (2, 3, -2, 5):
    close(cloam.grad(cloam.sum(p ** n), [p])[0], n * a ** (n - 1))
close(abs(a) ** t, abs(a) ** a); close(cloam.tensor(abs(a)) ** 0.5, abs(a) ** 0.5); close(2 ** t, 2 ** a)
assert (whole ** 2).dtype == np.int32 and (whole ** 2).numpy().tolist() == [1, 4, 9]
assert (whole / 2).dtype == np.float32 and (whole / 2).numpy().tolist() == [0.5, 1, -1.5]
assert (1 / whole).numpy()[1] == 0.5 and (whole % 2).numpy().shape == (3,)
assert whole.dtype == np.int32 and cloam.tensor(3).item() == 3 and cloam.tensor([[True]]).dtype == np.int32
assert type(whole[1].item()) is int and float(whole[2]) == -3 and type(t[0, 0].item()) is float
assert cloam.tensor(np.array([200], np.uint8)).item() == 200
two = np.int64(2)
close(t + two, a + 2); close(t + (1 << 70), a + 2.0 ** 70); close(two * t, a * 2); close(t[np.int64(1)], a[1]); close(t[..., two], a[..., 2])
close(t.reshape(np.int64(6)), a.ravel()); close(t.reshape(two, 3), a); close(t + np.array(5), a + 5)
close(cloam.sum(t, axis=np.int64(1)), a.sum(1)); close(cloam.max(t, axis=np.array([0, 1])), a.max())
assert ((t == 1.5).numpy() == (a == 1.5)).all() and ((t != t).numpy() == 0).all()
assert ((a == t).numpy() == 1).all() and ((3 != t).numpy() == (a != 3)).all()
assert t != None and not t == "text" and t in {t: 1} and len({t, cloam.tensor(a)}) == 2
assert [row.numpy().tolist() for row in t] == a.tolist()
try: list(cloam.tensor(5.0))
except TypeError: print("well")
)") == "well\n");
}

TEST_CASE("python: an array in place outlives its tensor, cannot be written, and keeps its memory from others") {
  CHECK(printed(R"(
import gc
made = lambda k: (cloam.random_uniform((1 << 16,), seed=k) * 2.0).numpy()
shares = cloam.device().shares_host_memory
arrays = [made(k) for k in range(8)]
copies = [a.copy() for a in arrays]
gc.collect()
for k in range(8, 40): made(k)  # memory that is free is used again
assert all((a == c).all() for a, c in zip(arrays, copies))
if shares:
    assert not arrays[0].flags.writeable and not arrays[0].flags.owndata
t = cloam.random_uniform((1 << 16,), seed=99) + 0.0
view = t.numpy()
want = view.copy()
cloam.eval(t * 3.0, t + 1.0)
cloam.assign(t, np.zeros(1 << 16, np.float32))
assert (view == want).all() and (t.numpy() == 0).all()
held = cloam.memory_in_use()
del arrays, view
gc.collect()
assert not shares or cloam.memory_in_use() < held
print("well")
)") == "well\n");
}

TEST_CASE("python: a render is pixel for pixel that of render") {
  CHECK(equal_pictures(small_street_run(), folder() / "street-raw") > 0);
  CHECK(equal_pictures(small_run(), folder() / "photos-raw") > 0);
}

TEST_CASE("python: an edited run is that of edit, file by file") {
  const fs::path mine = folder() / "edited", other = folder() / "edited-by-program";
  const std::string actor = json_of(small_street_run() / "scene.json").at("scenes").at(0).at("actors").at(0).at("id");
  const std::string words = actor + ":shift=2,0,0,rotate=90";
  printed("run = cloam.load(sys.argv[1])\nrun.edit([sys.argv[2]]).save(sys.argv[3])\nassert run.actors()\n",
          {small_street_run().string(), words, mine.string()});
  must({"edit", small_street_run().string(), "--actor", words, "-o", other.string()});
  CHECK(content_of(mine / "scene.json") == content_of(other / "scene.json"));
  CHECK(content_of(mine / "scene.json") != content_of(small_street_run() / "scene.json"));
  CHECK(checkpoint_in(mine) == checkpoint_in(other));
  CHECK(equal_pictures(mine, folder() / "edited-raw") > 0);
}

TEST_CASE("python: generated assets are those of generate, byte for byte") {
  const fs::path mine = folder() / "assets", other = folder() / "assets-by-program";
  const std::string run = small_diffusion_run().string();
  printed(R"(
run = cloam.load(sys.argv[1])
run.write_assets(sys.argv[2], count=3, seed=7, meshes=False)
assets = run.generate(3, seed=7)
assert [a.code.shape for a in assets] == [assets[0].code.shape] * 3 and all(min(a.size) > 0 for a in assets)
)",
          {run, mine.string()});
  printed(R"(
first = cloam.load(sys.argv[1]).generate(3, seed=7)  # nothing was written before
run = cloam.load(sys.argv[1])
run.write_assets(sys.argv[2], count=1, meshes=False)
assert all((a.code == b.code).all() for a, b in zip(first, run.generate(3, seed=7)))
try: run.views()
except cloam.Error as error: assert error.fault == cloam.Fault.usage and "has no views" in str(error), error
else: raise AssertionError("views of a run of diffusion")
)",
          {run, mine.string() + "-again"});
  must({"generate", run, "-n", "3", "--seed", "7", "--no-meshes", "-o", other.string()});
  CHECK(content_of(mine / "latents.safetensors") == content_of(other / "latents.safetensors"));
  CHECK(content_of(mine / "grid.png") == content_of(other / "grid.png"));
}

namespace {

constexpr char kTrain[] = R"(
small = {"field.levels": 4, "field.log2_rows": 8, "batch.rays": 32, "batch.samples": 512, "occupancy.side": 16,
         "occupancy.cells": 256}
def begin(out, **more):
    return cloam.Training("nerf", sys.argv[1], out=out, steps=6, seed=5, settings=small, **more)
)";

Words same_training(const fs::path& run) {
  Words words = {"train",  "nerf", small_scene().string(), "-o",  run.string(), "--steps", "6",
                 "--seed", "5",    "--pictures",           "off", "-q"};
  for (const char* setting : {"field.levels=4", "field.log2_rows=8", "batch.rays=32", "batch.samples=512",
                              "occupancy.side=16", "occupancy.cells=256"})
    words.insert(words.end(), {"--set", setting});
  return words;
}

}  // namespace

TEST_CASE("python: a training makes train's checkpoints, byte for byte, also one that is resumed") {
  const fs::path mine = folder() / "run", other = folder() / "run-by-program", again = folder() / "resumed";
  const std::string out = printed(std::string(kTrain) + R"(
with begin(sys.argv[2]) as training:
    reports = list(training)
assert [r["step"] for r in reports] == list(range(1, 7)) and all(r["of"] == 6 for r in reports)
assert training.step() is None
with begin(sys.argv[3], stop_after=2) as training:
    assert len(list(training)) == 2
with cloam.Training.resume(sys.argv[3]) as training:
    training.step()
    training.save()
training = cloam.Training.resume(sys.argv[3])
print(training.folder, len(list(training)), training.end().name)
)",
                                  {small_scene().string(), mine.string(), again.string()});
  must(same_training(other));
  CHECK(contains(out, again.string() + " 3 "));
  CHECK(checkpoint_in(mine) == checkpoint_in(other));
  CHECK(checkpoint_in(again) == checkpoint_in(other));
  CHECK(content_of(mine / "scene.json") == content_of(other / "scene.json"));
  CHECK(json_of(mine / "run.json").at("state") == "finished");
  must({"eval", mine.string()});
}

TEST_CASE("python: threads that train and render at once make the bytes of one after the other") {
  const fs::path other = folder() / "threads-by-program";
  const std::string out =
      printed(std::string(kTrain) + R"(
run = cloam.load(sys.argv[2])
want = [run.render(v).image for v in run.views()]
wrong = []
def train(name):
    try:
        with begin(name) as training: list(training)
    except BaseException as error: wrong.append(error)
def look(_):
    try:
        mine = cloam.load(sys.argv[2])
        for of in (mine, run):  # one of its own, and one that both use
            for v, image in zip(of.views(), want): assert (of.render(v).image == image).all()
    except BaseException as error: wrong.append(error)
work = [threading.Thread(target=f, args=(sys.argv[3] + str(i),)) for i, f in enumerate((train, look, train, look))]
for t in work: t.start()
for t in work: t.join()
assert not wrong, wrong
print("well")
)",
              {small_scene().string(), small_street_run().string(), (folder() / "thread").string()});
  CHECK(out == "well\n");
  must(same_training(other));
  CHECK(checkpoint_in(folder() / "thread0") == checkpoint_in(other));
  CHECK(checkpoint_in(folder() / "thread2") == checkpoint_in(other));
}

TEST_CASE("python: Ctrl-C ends a training between two steps, and it can be resumed") {
  const fs::path run = folder() / "interrupted";
  const std::string out = printed(std::string(kTrain) + R"(
import os, signal
try:
    with cloam.Training("nerf", sys.argv[1], out=sys.argv[2], steps=100000, settings=small) as training:
        for report in training:
            if report["step"] == 3: os.kill(os.getpid(), signal.SIGINT)
except KeyboardInterrupt:
    print("stopped at", report["step"])
)",
                                  {small_scene().string(), run.string()});
  CHECK(contains(out, "stopped at 3"));
  CHECK(json_of(run / "run.json").at("step") == 3);
  CHECK(json_of(run / "run.json").at("state") == "interrupted");
  must({"train", "--resume", run.string(), "--stop-after", "4", "--pictures", "off", "-q"});
}

TEST_CASE("python: errors are cloam.Error with the program's words and its exit code as fault") {
  const std::string missing = (folder() / "no-run").string();
  const std::string out = printed(R"(
def told(what):
    try: what()
    except cloam.Error as error: print(error.fault.name, int(error.fault), str(error).split("\n")[0])
told(lambda: cloam.load(sys.argv[1]))
told(lambda: cloam.Training("nref", "x"))
told(lambda: cloam.Training("nerf", "x", no_option=1))
told(lambda: cloam.tensor(np.zeros(2, np.complex64)))
told(lambda: cloam.choose_device("none"))
told(lambda: cloam.tensor(np.zeros((2, 3))) @ cloam.tensor(np.zeros((2, 3))))
told(lambda: cloam.psnr(np.zeros((2, 2, 3)), np.zeros((2, 3, 3))))
)",
                                  {missing});
  const Outcome same = cloam_with({"render", missing, "-o", missing});
  std::istringstream lines(out);
  std::string line;
  std::getline(lines, line);
  CHECK_MESSAGE(contains(same.err, line.substr(std::string("usage 2 ").size())), same.err, out);
  CHECK(line.starts_with("usage 2 "));
  for (const char* begin : {"usage 2 ", "usage 2 ", "usage 2 "}) {
    std::getline(lines, line);
    CHECK_MESSAGE(line.starts_with(begin), out);
  }
  CHECK_MESSAGE(contains(out, "nerf"), out);
  CHECK_MESSAGE(contains(out, "internal 1 [matmul]"), out);
}

TEST_CASE("python: a wrong value is told with its name") {
  const std::string out = printed(R"(
def told(what, *parts):
    try: what()
    except cloam.Error as error:
        assert error.fault == cloam.Fault.usage and all(part in str(error) for part in parts), error
    else: raise AssertionError(parts)
image = np.zeros((4, 4, 3))
told(lambda: cloam.parameter("abc"), "a parameter", "<U3")
told(lambda: cloam.parameter([[1], [2, 3]]), "a parameter")
told(lambda: cloam.parameter(None), "a parameter", "object")
told(lambda: cloam.parameter(np.ones(2, np.complex64)), "a parameter", "complex64")
told(lambda: cloam.psnr(np.full((4, 4, 3), "a"), image), "an image", "<U1")
told(lambda: cloam.tensor([1 << 40]), "int32")
told(lambda: cloam.tensor(np.array([1, 2])), "int64")  # the type is the caller's choice
told(lambda: cloam.sum(cloam.ones([2]), axis="x"), "axis='x'")
told(lambda: cloam.load(b"missing/\xff\xfe"), "missing/")
run = cloam.load(sys.argv[1])
told(lambda: run.actors(9), "scene 9")
told(lambda: run.actors(-1), "scene -1")
lens = (1, 1, 1, 1)
told(lambda: cloam.View(np.eye(4), 0, 5, lens), "0x5")
told(lambda: run.views("all")[0].resized(3, -1), "3x-1")
told(lambda: run.generate(night="x"), "night='x'", "True or False")
told(lambda: run.generate(seed=-1), "seed=-1", "from 0 on")
print("well")
)",
                                  {small_street_run().string()});
  CHECK(out == "well\n");
}

TEST_CASE("python: a training that cannot be is refused as train refuses it, and leaves no folder") {
  const fs::path run = folder() / "refused";
  const std::string out = printed(R"(
import math
wrong = [("steps", 0), ("steps", -1), ("steps", "a"), ("gradient_accumulation", 0), ("gradient_accumulation", 5000),
         ("holdout", -1), ("holdout", 1), ("save_every", -1), ("stop_after", -1), ("time_budget", -5),
         ("time_budget", math.nan), ("time_budget", math.inf), ("precision", "foo"), ("seed", -1), ("downscale", 0),
         ("protocol", "sparce"), ("masks", "no"), ("actors", "road_users"), ("settings", "a=b")]
for name, value in wrong:
    try: cloam.Training("nerf", sys.argv[1], out=sys.argv[2], **{name: value})
    except cloam.Error as error:
        assert error.fault == cloam.Fault.usage and name.replace("_", "-") in str(error).replace("_", "-"), error
    else: raise AssertionError(name)
print("well")
)",
                                  {small_scene().string(), run.string()});
  CHECK(out == "well\n");
  CHECK_FALSE(fs::exists(run));
}

TEST_CASE("python: figures are those of eval's definitions") {
  CHECK(printed(R"(
rng = np.random.default_rng(2)
a = rng.integers(0, 256, (24, 32, 3), dtype=np.uint8)
b = (a // 2 + 20).astype(np.uint8)
mse = np.mean((a / 255.0 - b / 255.0) ** 2)
assert abs(cloam.psnr(a, b) + 10 * np.log10(mse)) < 1e-3 and cloam.psnr(a, a) == np.inf
assert abs(cloam.psnr(a / 255.0, b / 255.0) - cloam.psnr(a, b)) < 1e-4
assert cloam.ssim(a, a) == 1 and cloam.ssim(a, b) < 0.99
p, q = rng.random((40, 3)).astype("f4"), rng.random((30, 3)).astype("f4")
d = ((p[:, None] - q[None]) ** 2).sum(-1)
assert abs(cloam.chamfer(p, q) - d.min(1).mean() - d.min(0).mean()) < 1e-6
print("well")
)") == "well\n");
}

TEST_CASE("python: the tour of examples/python runs from top to bottom") {
  const fs::path tour = fs::path(CLOAM_SOURCE) / "examples" / "python" / "tour.py";
  const std::string out =
      printed("exec(compile(open(sys.argv.pop(1)).read(), 'tour', 'exec'))",
              {tour.string(), small_street_run().string(), small_scene().string(), (folder() / "tour").string()});
  CHECK_MESSAGE(contains(out, "y = 2.0"), out);
  CHECK_MESSAGE(contains(out, "edited:"), out);
  CHECK_MESSAGE(contains(out, "step 4 of 4"), out);
  CHECK_MESSAGE(contains(out, "Fault.usage 2 "), out);
}

#else

TEST_CASE("python: the module") { MESSAGE("skipped: Python's headers, NumPy or pybind11 were not found"); }

#endif
