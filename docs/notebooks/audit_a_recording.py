# %% [markdown]
# # Audit a recording and apply the remedy
#
# The paper's filter multiplies samples, taxels and taps as if they were independent given the class.
# Here three sessions come from a sensor with strong noise that all taxels share.
# The audit finds that cause, says what it costs, and chooses a remedy, which is then applied.

# %%
from textwrap import fill

import matplotlib.pyplot as plt

import solidtouch as st

train, tune, measure = st.simulate("broken", sessions=3, seed=0)
report = st.audit(train, tune, measure, permutations=199, trials=1000, resamples=40)
print("\n\n".join(fill(sentence, 90) for sentence in report.verdict))

# %% [markdown]
# ## Causes
#
# Where the variance of the evidence comes from, beyond what independence allows.

# %%
report.plot("causes", figure=plt.figure(figsize=(8, 4.5), layout="constrained"))
plt.show()

# %% [markdown]
# ## Remedies
#
# Each remedy is tuned on the second session and measured on the third.

# %%
report.plot("remedies", figure=plt.figure(figsize=(8, 4), layout="constrained"))
plt.show()

# %% [markdown]
# ## Apply it
#
# `report.setting` and `report.model` are the setting and the model that the audit recommends.
# On the command line: `solidtouch perceive audit/model.nc --setting audit/setting.json`.

# %%
print(fill(report.setting.note, 90))
thresholds = [0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99]
plain = st.trials(st.fit(train), measure, 20_000, stop=thresholds)
better = st.trials(report.model, measure, 20_000, stop=thresholds, play=report.setting.play)

# %% [markdown]
# A decision at a belief of 0.9 should be wrong once in ten times at most. The remedy brings the errors nearer to the line, not below it everywhere.
# Bands are 95% intervals. What is left differs from session to session, which one training session cannot show.

# %%
figure, axes = plt.subplots(figsize=(5, 3.6), layout="constrained")
for label, run, colour in (("as the paper", plain, "#d55e00"), ("with the remedy", better, "#0072b2")):
    wrong = run.results
    axes.plot(thresholds, wrong.what_wrong, "o-", color=colour, label=label)
    axes.fill_between(thresholds, wrong.what_wrong_low, wrong.what_wrong_high, color=colour, alpha=0.15, linewidth=0)
axes.plot(thresholds, [1 - theta for theta in thresholds], "--", color="black", label="at most, by the belief")
axes.set(xlabel="belief threshold", ylabel="fraction of wrong decisions", ylim=(0, None))
axes.legend(frameon=False)
plt.show()
