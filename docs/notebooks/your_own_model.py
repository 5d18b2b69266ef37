# %% [markdown]
# # Write your own model
#
# A measurement model is one NumPyro function that says how the samples of taps of known class come about.
# This notebook writes one, fits it, perceives with it, and compares it with two built-in models.

# %%
import matplotlib.pyplot as plt
import numpy as np
import numpyro
import numpyro.distributions as dist

import solidtouch as st

train, test = st.simulate("paper", sessions=2, seed=4)

# %% [markdown]
# ## Look at the taps
#
# A tap has 50 samples of 12 taxels. These are the samples of one taxel in the 20 taps of one class, a rod at a position.

# %%
where, what = train.indices(train.grid())
own = np.asarray(train.select((where == 7) & (what == 2)).taps)[:, :, 5]
figure, (left, right) = plt.subplots(1, 2, figsize=(8, 2.8), layout="constrained")
left.plot(own.T, color="#0072b2", linewidth=0.8, alpha=0.6)
left.set(xlabel="sample", ylabel="taxel 5 (counts)", title="20 taps of one class")
right.hist(own.ravel(), bins=40, color="#0072b2")
right.set(xlabel="taxel 5 (counts)", ylabel="samples", title="their samples")
plt.show()

# %% [markdown]
# A sharp peak with long tails looks less like a normal than like a Laplace distribution; the comparison below decides.
#
# ## The model
#
# `L`, `M`, `J` and `K` are the numbers of positions, objects, samples and taxels; samples are standardised.


# %%
def laplace(where, what, taps=None, *, L, M, J, K):
    """Samples of a class and taxel follow a Laplace distribution."""
    with numpyro.plate("L", L, dim=-3), numpyro.plate("M", M, dim=-2), numpyro.plate("K", K, dim=-1):
        loc = numpyro.sample("loc", dist.Normal(0.0, 3.0))
        scale = numpyro.sample("scale", dist.LogNormal(0.0, 1.0))
    with numpyro.plate("tap", len(where), dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("taxel", K, dim=-1):
        level, spread = loc[where, what][:, None], scale[where, what][:, None]
        numpyro.sample("taps", dist.Laplace(level, spread), obs=taps)


model = st.fit(train, model=laplace)
print(model)

# %% [markdown]
# [Your own measurement model](../how-to/your-own-model.md) says what such a function may and may not do.
#
# ## Perceive with it

# %%
rig = st.SimulatedRig("paper", seed=4, session=1, position_mm=2.3, what=1)
episode = st.perceive(rig, model, stop=0.95, move=st.fixation(7))
print(f"{model.grid.what_name[episode.what]} after {episode.taps} taps, moves {episode.moves.tolist()}")

# %% [markdown]
# ## Compare it
#
# The same call as for built-in models. They are judged on a session that trained none of them; `draws=0` skips what
# needs draws from the posteriors, `folds=1` skips further fits.

# %%
report = st.compare(train, test, models=["histogram", "gaussian", laplace], draws=0, folds=1, trials=500, resamples=40)
print(report.tree["sessions_left_out"].ds[["integrated"]].to_dataframe().round(1))

# %% [markdown]
# The log probability of a tap is one thing, decisions are another: errors against the mean reaction time.

# %%
report.plot("decisions", figure=plt.figure(figsize=(8, 6), layout="constrained"))
plt.show()
