# %% [markdown]
# # Compare models and hand them to ArviZ
#
# Three measurement models are fitted to one session and judged on another: by the probability that they give to the taps
# of a session left out, by the belief in classes, and by decisions.

# %%
import arviz as az
import matplotlib.pyplot as plt
import numpy as np

import solidtouch as st

train, test = st.simulate("paper", sessions=2, seed=4)
models = ["histogram", "gaussian", "profile"]
report = st.compare(train, test, models=models, trials=500, resamples=40)
print(report.taps[["integrated", "integrated_low", "integrated_high"]].to_dataframe().round(0))

# %% [markdown]
# The log probability of a tap of a session left out, in nats, integrated over the posterior.
#
# ## Weights of models
#
# `report.elpd` holds the log probability of each group of taps left out, as `arviz.compare` takes it.

# %%
az.compare(report.elpd)

# %% [markdown]
# ## Why PSIS fails here
#
# PSIS-LOO leaves out a tap by giving other weights to the draws of the posterior.
# A tap has 50 samples of 12 taxels, and each class has only twenty taps: without one of them the posterior of its class is
# elsewhere, where there are no draws.
# The Pareto k of a tap says so: above 0.7 its estimate cannot be trusted.
#
# These three models have posteriors in closed form, so each tap can also be left out exactly.

# %%
left_out = report.tree["taps_left_out"]
for model in models:
    taps = left_out.ds.sel(model=model).isel(tap=left_out.looked_at.sel(model=model).values)
    wrong = np.abs(taps.psis - taps.exact)
    print(
        f"{model}: Pareto k > 0.7 for {float((taps.pareto_k > 0.7).mean()):.0%} of {taps.sizes['tap']} taps, "
        f"error of PSIS {float(wrong.median()):.1f} nats (median), {float(wrong.max()):.1f} (largest)"
    )

# %% [markdown]
# More draws do not help, because it is the taps that are few.
# `st.compare` therefore ranks by sessions left out, for which the models are fitted again.

# %%
figure, panels = plt.subplots(1, len(models), figsize=(9, 3.2), sharey=True, layout="constrained")
for axes, model in zip(panels, models, strict=True):
    taps = left_out.ds.sel(model=model)
    axes.plot(taps.pareto_k, taps.psis - taps.exact, "o", color="#0072b2", markersize=3, alpha=0.6)
    axes.axvline(0.7, color="#d55e00", linewidth=1)
    axes.axhline(0, color="black", linewidth=0.6)
    axes.set(title=model, xlabel="Pareto k", yscale="symlog")
panels[0].set_ylabel("PSIS − exact log probability\nof a tap left out (nats)")
plt.show()

# %% [markdown]
# To the right of the line PSIS is off by many nats, on average towards taps that look too probable.
# [Use ArviZ](../how-to/arviz.md) lists the functions that work, [comparison](../explanation/comparison.md) has all nine models.
