"""What Python can do with cloam, cell by cell (`# %%`: editors and Jupyter's tools show them as a notebook).

    python3 tour.py RUN DATA OUT

RUN: a trained run with views; DATA: a capture to train on for a moment; OUT: a new folder.
"""
# %% The device: a GPU if there is one; cloam.choose_device("cpu") chooses another, before anything is computed.
import sys
from pathlib import Path

import numpy as np

import cloam

run_folder, data, out = (Path(word) for word in sys.argv[1:4])
print("devices:", *cloam.devices())
print("computes on", cloam.device().name)

# %% Tensors and gradients: a line is fitted to points.
x = cloam.tensor(np.arange(4, dtype=np.float32))
y = cloam.tensor(np.array([1, 3, 5, 7], np.float32))
slope, offset = cloam.parameter([0.0]), cloam.parameter([0.0])
optimiser = cloam.Adam([slope, offset], learning_rate=0.1)
for _ in range(300):
    loss = cloam.mean(cloam.square(slope * x + offset - y))
    optimiser.step(cloam.grad(loss, [slope, offset]))
print(f"y = {slope.item():.2f} x + {offset.item():.2f}")

# %% A trained run: its held-out views, and one from a little to the right.
run = cloam.load(run_folder)
views = run.views("test")
picture = run.render(views[0])
print(run, "shows", views[0].name, picture.image.shape, "with opacity up to", round(float(picture.opacity.max()), 3))
pose = views[0].pose
views[0].pose = pose @ np.array([[1, 0, 0, 0.1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
moved = run.render(views[0])
print(f"psnr of the two: {cloam.psnr(picture.image, moved.image):.1f} dB, ssim {cloam.ssim(picture.image, moved.image):.3f}")

# %% Actors of a street: one is taken away. The run itself stays as it is; save() writes the edited one.
if run.actors():
    edited = run.edit([run.actors()[0] + ":remove"])
    edited.save(out / "edited")
    print("edited:", cloam.load(out / "edited"))

# %% A training, one step at a time. Its folder is one of `cloam train`'s: cloam render, eval and view take it.
with cloam.Training("splat", data, out=out / "run", steps=4, settings={"initial": "random", "initial.random": 100}) as training:
    for report in training:
        print("step", report["step"], "of", report["of"], f"loss {report['loss']:.4f}")
print(cloam.load(out / "run"))

# %% Errors say what was looked for, what was found and how to mend it.
try:
    cloam.load(out / "no-run")
except cloam.Error as error:
    print(error.fault, int(error.fault), error)
