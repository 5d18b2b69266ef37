# %% [markdown]
# # Validate a program in another language
#
# The conformance kit gives a program cases with exact answers and compares every number.
# The program here is the small one in C that comes with the documentation; a compiler called `cc` is needed.

# %%
import json
import subprocess
from pathlib import Path
from tempfile import mkdtemp
from textwrap import fill

import matplotlib.pyplot as plt
import numpy as np

import solidtouch as st

here = Path(__file__).parent if "__file__" in globals() else Path()
source = here / ".." / "reference" / "conformance" / "solid.c"
work = Path(mkdtemp())


def compiled(code, name):
    """The program that a C compiler makes of the code."""
    (work / f"{name}.c").write_text(code)
    subprocess.run(["cc", "-O2", "-std=c99", "-o", work / name, work / f"{name}.c", "-lm"], check=True)
    return str(work / name)


program = compiled(source.read_text(), "solid")
report = st.conformance.run_program(program)
print(f"{len(report.found)} cases, passed: {report.passed}")

# %% [markdown]
# ## A mistake
#
# The belief is shifted against the move instead of with it, a single sign.
# The first answer that differs tells the mistake from others, because the kit knows what each of them makes of the cases.

# %%
wrong = compiled(source.read_text().replace("    shift(m, s, move);", "    shift(m, s, -move);"), "wrong")
report = st.conformance.run_program(wrong)
wrong_cases = [verdict for verdict in report.found.values() if verdict.status == "differs"]
print(f"{len(wrong_cases)} of {len(report.found)} cases differ, among them:")
print(*(fill(str(verdict), 90) for verdict in wrong_cases[:4]), sep="\n")

# %% [markdown]
# ## What the program believes
#
# One case as both programs answer it: the belief in the positions after each tap.

# %%
case = "shift-uniform"
st.conformance.export(work / "kit", [case])
lines = (work / "kit" / f"{case}.jsonl").read_text()


def answers(command):
    """Belief in the positions after each tap, shape (T, L)."""
    done = subprocess.run([command], input=lines, capture_output=True, text=True, check=True)
    told = [json.loads(line) for line in done.stdout.splitlines()]
    return np.array([answer["where"] for answer in told if "where" in answer])


exact = np.array([answer["where"] for answer in st.conformance.expected(case)])
figure, panels = plt.subplots(1, 3, figsize=(8, 2.8), sharey=True, layout="constrained")
for axes, (title, belief) in zip(
    panels, {"exact": exact, "solid.c": answers(program), "wrong sign": answers(wrong)}.items(), strict=True
):
    picture = axes.imshow(belief, vmin=0, vmax=1, cmap="viridis", aspect="auto")
    axes.set(title=title, xlabel="position", xticks=range(belief.shape[1]))
panels[0].set(ylabel="tap", yticks=range(len(exact)), yticklabels=range(1, len(exact) + 1))
figure.colorbar(picture, ax=panels, label="belief")
plt.show()
