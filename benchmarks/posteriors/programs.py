"""Runs the Stan programs in docs/reference/posteriors by rstan and compares their draws with the references.

python -m benchmarks.posteriors.stan --document docs/reference/posteriors/README.md
"""

import shutil
import subprocess
import sys
from argparse import ArgumentParser
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from solidtouch.analysis.posteriors.catalogue import export, posterior
from solidtouch.analysis.posteriors.comparison import compare_draws
from solidtouch.analysis.posteriors.files import read_draws

from benchmarks.page import parsed, table, write_block
from benchmarks.study import until_interrupted

FOLDER = Path("docs/reference/posteriors")
HEAD = ["program", "run by", "verdict", "moments", "largest difference", "limit", "worst R-hat", "least sample size"]


def row(rscript: str, folder: Path, program: Path) -> list[str]:
    """The row of a program in the table."""
    name, draws = program.stem, folder / f"{program.stem}.csv"
    words = [
        rscript,
        str(FOLDER / "sample.R"),
        str(program),
        str(folder / "reference" / f"{name}.data.json"),
        str(draws),
    ]
    subprocess.run(words, check=True, capture_output=True)  # noqa: S603 - R and a program of this repository
    verdict = compare_draws(posterior(name), read_draws([draws]))
    say = 'library(rstan); cat("Stan", stan_version(), "in rstan", format(packageVersion("rstan")))'
    said = subprocess.run([rscript, "-e", say], check=True, capture_output=True, text=True)  # noqa: S603 - as above
    largest, limit = abs(verdict.differences[0].z), verdict.limit
    numbers = [
        f"{len(verdict.differences)}",
        f"{largest:.1f}",
        f"{limit:.1f}",
        f"{verdict.r_hat:.3f}",
        f"{verdict.ess:.0f}",
    ]
    return [f"[{program.name}]({program.name})", said.stdout, verdict.status, *numbers]


def main() -> None:
    """Runs all Stan programs, where R is."""
    options = parsed(ArgumentParser(description=__doc__), "stan")
    rscript = shutil.which("Rscript")
    if rscript is None:
        sys.exit("There is no Rscript, which runs rstan.")
    with TemporaryDirectory() as folder:
        export(Path(folder) / "reference")
        tasks = [partial(row, rscript, Path(folder), program) for program in sorted(FOLDER.glob("*.stan"))]
        rows = [*until_interrupted("Stan programs", tasks)]
    write_block(options.document, "stan", table(HEAD, rows))
    for line in rows:
        print(*line, sep=" | ")


if __name__ == "__main__":
    main()
