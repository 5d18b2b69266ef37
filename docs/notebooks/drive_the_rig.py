# %% [markdown]
# # Drive the emulated rig
#
# An emulator stands in for a fingertip on a stage: it speaks the protocols of the devices on pseudo-terminals, and runs on
# Linux and macOS. The commands are those of a bench, where your own `rig.toml` takes its place.

# %%
import atexit
import json
import subprocess
import sys
import time
from pathlib import Path
from tempfile import mkdtemp

import matplotlib.pyplot as plt
import numpy as np

import solidtouch as st

work = Path(mkdtemp())
solidtouch = [sys.executable, "-m", "solidtouch.cli"]
plan = """\
session = 0
settle_taps = 1

[positions]
start_mm = 0.0
end_mm = 16.0
spacing_mm = 0.25

[[objects]]
name = "4 mm rod"
size_mm = 4

[[objects]]
name = "8 mm rod"
size_mm = 8

[[objects]]
name = "12 mm rod"
size_mm = 12
"""
(work / "plan.toml").write_text(plan)
silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
emulator = subprocess.Popen([*solidtouch, "emulate", "--out", work / "bench", "--seed", "4"], **silent)
atexit.register(emulator.terminate)  # also after an error
while not (work / "bench" / "control").exists():
    time.sleep(0.1)


def run(*words):
    """What a command prints."""
    done = subprocess.run([*solidtouch, *map(str, words)], cwd=work, capture_output=True, text=True, check=True)
    return done.stdout


# %% [markdown]
# ## Collect training taps
#
# Three rods, four taps in each millimetre.

# %%
print(run("collect", "bench/rig.toml", "plan.toml", "--out", "session-0.mcap", "--home"))
model = st.fit(work / "session-0.mcap")
model.save(work / "model.nc")
print(model)

# %% [markdown]
# ## Perceive
#
# With `--json` each tap is an object on one line: the belief, the evidence, and the move that follows.
# Without it the terminal shows a picture that is redrawn after each tap. `--save-episode` keeps the episode for below.

# %%
words = [
    "--rig",
    "bench/rig.toml",
    "--object",
    "8 mm rod",
    "--start",
    "2.3mm",
    "--json",
    "--save-episode",
    "episode.json",
]
taps = [json.loads(line) for line in run("perceive", "model.nc", *words).splitlines()]
*taps, end = taps
print({key: end[key] for key in ("decision", "where", "reason", "taps", "right")})

# %% [markdown]
# `--view` shows each tap at once on [a page in the browser](../how-to/perceiving.md#watching-in-a-browser), and `solidtouch
# view episode.json` later. Here it is as part of this notebook; the space bar plays it.

# %%
st.view(work / "episode.json", browser=False)

# %%
emulator.terminate()
ended = emulator.wait()

# %% [markdown]
# The belief in position and object after each tap; the finger begins near the end of the range and moves to the middle.

# %%
figure, panels = plt.subplots(1, 2, figsize=(8, 3), layout="constrained", width_ratios=[3, 1])
for axes, name in zip(panels, ["where_marginal", "what_marginal"], strict=True):
    belief = np.array([tap[name] for tap in taps])
    picture = axes.imshow(belief, vmin=0, vmax=1, cmap="viridis", aspect="auto")
    axes.set_yticks(range(len(taps)), range(1, len(taps) + 1))
panels[0].set(xlabel="position class", ylabel="tap")
panels[1].set_xticks(range(3), ["4", "8", "12"])
panels[1].set_xlabel("rod (mm)")
figure.colorbar(picture, ax=panels, label="belief")
plt.show()
