# %% [markdown]
# # Reproduce the paper and change one thing
#
# Active perception moves the finger to a fixation point, passive perception taps where it starts.
# This notebook runs the paper's experiment on simulated taps and then asks what happens if the fixation point is at the
# end of the range, where rods are hard to distinguish.

# %%
import matplotlib.pyplot as plt

import solidtouch as st

report = st.reproduce(data_sets=4, trials=300, seed=0)
at = report.decisions.sel(theta=0.95, drop=True)
print(at[["what_error", "what_error_low", "what_error_high", "where_error", "taps"]].to_dataframe().round(2))

# %% [markdown]
# Errors in mm of the object (`what`) and the position (`where`), with a 95% interval, and mean reaction times in taps.
#
# Figure 7 of the paper: errors of object and position against the threshold and the mean reaction time.

# %%
report.plot("fig7", figure=plt.figure(figsize=(8, 5), layout="constrained"))
plt.show()

# %% [markdown]
# ## One thing changed
#
# `PlaySettings` holds what an episode depends on: threshold, fixation point, border, deadline.
# The middle of the range, position 7, is the default fixation point.

# %%
moved = st.reproduce(data_sets=4, trials=300, seed=0, play=st.PlaySettings(fixation=1))

for name, run in {"middle": report, "end of the range": moved}.items():
    active = run.decisions.sel(policy="active", theta=0.95)
    print(f"fixation point at the {name}: {float(active.what_error):.2f} mm, {float(active.taps):.1f} taps")

# %% [markdown]
# Results are labelled arrays, so curves of both runs go into one figure.
# Bands are 95% intervals over the data sets.

# %%
figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
curves = {
    "passive": (report, "passive", "#d55e00"),
    "active, middle": (report, "active", "#000000"),
    "active, end of the range": (moved, "active", "#0072b2"),
}
for label, (run, policy, colour) in curves.items():
    curve = run.decisions.sel(policy=policy)
    axes.plot(curve.taps, curve.what_error, "o-", color=colour, markersize=3, label=label)
    low, high = curve.what_error_low, curve.what_error_high
    axes.fill_between(curve.taps, low, high, color=colour, alpha=0.15, linewidth=0)
axes.set(xlabel="mean reaction time (taps)", ylabel="object error (mm)", ylim=(0, None))
axes.legend(frameon=False)
plt.show()

# %% [markdown]
# A finger that moves is no better for it: what matters is that it moves to where objects differ.
# [Tuning](../how-to/tuning.md) chooses that position from training taps.
