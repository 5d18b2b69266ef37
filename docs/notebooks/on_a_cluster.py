# %% [markdown]
# # A study on a cluster
#
# A sweep plays the same trials over a grid of settings.
# Given the address of a Dask scheduler, its cells run on that cluster; here it is a `LocalCluster` on this machine, in a
# laboratory it would be SLURM or a few workstations, and nothing else would change.

# %%
from pathlib import Path
from tempfile import mkdtemp

import matplotlib.pyplot as plt
from distributed import LocalCluster

import solidtouch as st

work = Path(mkdtemp())
study = work / "study.toml"
study.write_text("""\
name = "smoothing and root"
trials = 500
thresholds = [0.5, 0.7, 0.8, 0.9, 0.95, 0.99]

[[data]]
name = "paper"
preset = "paper"
seeds = [0, 1]

[grid]
pseudocount = [0.001, 0.01, 0.1, 1.0]
power = ["J", "JK"]
policy = ["passive", "active"]
""")

# Workers are threads here, so that this file also runs as a plain script; processes=True makes them processes.
place = {"processes": False, "protocol": "tcp://", "host": "127.0.0.1", "dashboard_address": None}
with LocalCluster(n_workers=2, threads_per_worker=1, **place) as cluster:
    report = st.sweep(study, work / "study.zarr", scheduler=cluster.scheduler_address)

# %% [markdown]
# The results are labelled by the axes of the study.
# Each cell was written when it was finished, so the same call would go on after an interruption.

# %%
results = report.results.squeeze(drop=True).load()
print(dict(results["what_error"].sizes))

# %% [markdown]
# In these two data sets a larger pseudocount gives fewer errors, and the root 1/JK takes more taps without a gain.
# Two data sets are an example; [open choices](../explanation/open-choices.md) has intervals for both.

# %%
figure, panels = plt.subplots(1, 2, figsize=(8, 3.4), sharey=True, layout="constrained")
for axes, power in zip(panels, ["J", "JK"], strict=True):
    for colour, pseudocount in zip(
        ["#000000", "#0072b2", "#d55e00", "#009e73"], results["pseudocount"].values, strict=True
    ):
        cell = results.sel(power=power, pseudocount=pseudocount, policy="active").mean("data")
        axes.plot(cell["taps"], cell["what_error"], "o-", color=colour, markersize=3, label=f"{pseudocount:g}")
    axes.set(title=f"power {power}", xlabel="mean reaction time (taps)")
panels[0].set(ylabel="object error (mm)", ylim=(0, None))
panels[1].legend(title="pseudocount", frameon=False)
plt.show()
