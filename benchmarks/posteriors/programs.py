"""Runs the programs in docs/reference/posteriors, in Stan and PyMC, and compares their draws with the references.

python -m benchmarks.posteriors.programs --python PATH --document docs/reference/posteriors/README.md

PATH is a Python with PyMC, h5netcdf and h5py. Without it, or without R, rstan and jsonlite, lines of the table stay as
they are.
"""

import shutil
import subprocess
import sys
from argparse import ArgumentParser
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from solidtouch.analysis.posteriors.catalogue import export, posterior
from solidtouch.analysis.posteriors.comparison import compare_draws
from solidtouch.analysis.posteriors.files import read_draws

from benchmarks.page import parsed, write_rows
from benchmarks.study import until_interrupted

FOLDER = Path("docs/reference/posteriors")
HEAD = ["program", "run by", "verdict", "moments", "largest difference", "limit", "worst R-hat", "least sample size"]
STAN = 'library(rstan); library(jsonlite); cat("Stan", stan_version(), "in rstan", format(packageVersion("rstan")))'
PYMC = "import h5netcdf, h5py, pymc; print('PyMC', pymc.__version__)"
MODELS_OF_PYMC = ("profile-ar", "smooth")


def version(*words: str) -> str:
    """What a sampler calls itself; empty where it is missing."""
    if shutil.which(words[0]) is None:
        return ""
    done = subprocess.run(words, capture_output=True, text=True, check=False)  # noqa: S603 - R or Python, as above
    return "" if done.returncode else done.stdout.strip()


def row(label: str, by: str, words: Sequence[str | Path], name: str, draws: Path) -> list[str]:
    """The row of a program in the table; its last arguments are the data and the file of its draws."""
    data = draws.parent / "reference" / f"{name}.data.json"
    subprocess.run([*words, data, draws], check=True, capture_output=True)  # noqa: S603 - a program of this repository
    verdict = compare_draws(posterior(name), read_draws([draws]))
    numbers = [
        f"{len(verdict.differences)}",
        f"{abs(verdict.differences[0].z):.1f}",
        f"{verdict.limit:.1f}",
        f"{verdict.r_hat:.3f}",
        f"{verdict.ess:.0f}",
    ]
    return [label, by, verdict.status, *numbers]


def main() -> None:
    """Runs all programs whose sampler is there."""
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("--python", default=sys.executable, help="Python with PyMC")
    options = parsed(parser, "programs")
    tasks = []
    with TemporaryDirectory() as name:
        folder = Path(name)
        export(folder / "reference")
        if by := version("Rscript", "-e", STAN):
            for program in sorted(FOLDER.glob("*.stan")):
                words, draws = ["Rscript", FOLDER / "sample.R", program], folder / f"{program.stem}.csv"
                tasks += [partial(row, f"[{program.name}]({program.name})", by, words, program.stem, draws)]
        if by := version(options.python, "-c", PYMC):
            for model in MODELS_OF_PYMC:
                words, draws = [options.python, FOLDER / "sample_pymc.py", model], folder / f"{model}.nc"
                tasks += [partial(row, f"[sample_pymc.py](sample_pymc.py) {model}", by, words, model, draws)]
        if not tasks:
            sys.exit("There is neither R with rstan and jsonlite nor, by --python, PyMC.")
        rows = [*until_interrupted("Programs", tasks)]
    write_rows(options.document, "programs", HEAD, rows)
    for line in rows:
        print(*line, sep=" | ")


if __name__ == "__main__":
    main()
