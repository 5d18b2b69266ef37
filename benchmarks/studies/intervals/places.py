"""How often intervals of `compare --leave-out` cover the truth when positions or objects are drawn anew.

Levels of the taxels are the sum of a part of the object, a part of the position and one of both. In every data set the
positions (or objects) that are left out are drawn anew and the others stay, as if the study were repeated at other
positions of the same objects. In rows with neighbours alike the parts of the positions are a smooth curve, so that one
position says much of the next. The truth is the mean of all data sets.

`--document docs/explanation/intervals.md` updates the table of that page.
"""

import argparse
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from solidtouch.analysis.compare.groups import folds_of, known_taps, said, score_kinds, scorer
from solidtouch.analysis.compare.taps import TapScores, join_scores, mean_scores
from solidtouch.models.grid import ClassGrid
from solidtouch.models.measurement.registry import fit_model
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.seeds import data_set_seed
from solidtouch.models.settings import FitSettings
from solidtouch.models.taps import TapSet

from benchmarks.page import parsed, share_interval, table, write_block
from benchmarks.study import processes, until_interrupted, write_json

BLOCK = "places"
MODELS = ("histogram", "gaussian")
KINDS = ("integrated", "belief", "error")
QUANTITIES = tuple(f"{kind}{end}" for kind in KINDS for end in ("", "_difference"))
TITLES = (
    *("log probability", "difference"),
    *("log belief", "difference"),
    *("error", "difference"),
)
_SAMPLES, _TAXELS, _TAPS = 3, 4, 8
_SETTINGS = FitSettings(bins=15, pseudocount=0.1)


type _Found = dict[str, NDArray[np.float64]]


class Design(NamedTuple):
    """What is left out of what.

    Attributes:
        unit: What is left out and drawn anew.
        L: Positions.
        M: Objects.
        folds: At most so many.
        smooth: Whether positions resemble their neighbours.
    """

    unit: str
    L: int
    M: int
    folds: int = 99
    smooth: bool = False

    @property
    def name(self) -> str:
        """First cell of its row."""
        left_out = f"{self.L if self.unit == 'position' else self.M} {self.unit}s"
        groups = f" in {self.folds} folds" if self.folds < 99 else ""
        return left_out + groups + (", neighbours alike" if self.smooth else "")


DESIGNS = (
    Design("position", 6, 3),
    Design("position", 16, 3),
    Design("position", 16, 3, folds=6),
    Design("position", 16, 3, smooth=True),
    Design("position", 16, 3, folds=6, smooth=True),
    Design("object", 4, 5),
    Design("object", 4, 12),
)


def levels(design: Design, seed: int) -> NDArray[np.float64]:
    """Mean of each taxel in each class, shape (L, M, K); what is not drawn anew does not depend on the seed."""
    L, M, K = design.L, design.M, _TAXELS
    stays, anew = np.random.default_rng(0), np.random.default_rng([1, seed])
    at, of = (anew, stays) if design.unit == "position" else (stays, anew)
    position, both = at.normal(size=(L, 1, K)), anew.normal(size=(L, M, K))
    if design.smooth:
        place = np.arange(L)
        factor = np.linalg.cholesky(np.exp(-((place[:, None] - place) ** 2) / 18) + 1e-9 * np.eye(L))
        position, both = (np.einsum("lm,m...->l...", factor, part) for part in (position, both))
    return position + of.normal(size=(1, M, K)) + 0.5 * both


def taps_of(level: NDArray[np.float64], session: int, generator: np.random.Generator) -> TapSet:
    """Taps of all classes around their levels, with noise that the samples of a tap share in part."""
    where, what = (a.ravel() for a in np.indices((*level.shape[:2], _TAPS))[:2])
    shared, own = (generator.normal(size=(len(where), samples, level.shape[-1])) for samples in (1, _SAMPLES))
    names = [f"object {m}" for m in range(level.shape[1])]
    return TapSet.from_arrays(
        level[where, what][:, None] + 0.6 * shared + 0.8 * own,
        what,
        names,
        where=where.astype(float),
        session=np.full(len(where), session),
        preprocessing=Preprocessing(samples=_SAMPLES),
    )


def measured(design: Design, number: int) -> _Found:
    """Estimate and both ends of the interval of each quantity in one data set, shape (models, 3)."""
    seed = data_set_seed(0, number)
    generator, level = np.random.default_rng([2, seed]), levels(design, seed)
    train, test = (taps_of(level, session, generator) for session in (0, 1))
    grid: ClassGrid = train.grid()
    folds, _ = folds_of(design.unit, train, test, grid, design.folds)
    score = scorer(design.unit, folds, grid, seed)
    scores: dict[str, dict[str, list[TapScores]]] = {kind: {name: [] for name in MODELS} for kind in KINDS}
    for fold in folds:
        for name in MODELS:
            fitted = fit_model(name, fold.train, grid, _SETTINGS)
            taps = known_taps(fold.test, grid, said(fitted.model.trained, design.unit))
            for kind, part in score(fitted, taps, fitted.model.exponent).items():
                if kind in KINDS:
                    scores[kind][name].append(part)
    found, kinds = {}, score_kinds(design.unit, grid, in_bins=True)
    for kind, named in scores.items():
        whole = {name: join_scores(parts) for name, parts in named.items()}
        means = mean_scores(whole, MODELS[0], kind, kinds[kind])
        for end, names in (("", MODELS), ("_difference", MODELS[1:])):
            ends = [means[f"{kind}{end}{bound}"].sel(model=list(names)).values for bound in ("", "_low", "_high")]
            found[f"{kind}{end}"] = np.stack(ends, axis=-1)
    return found


def coverage(found: list[_Found]) -> dict[str, tuple[int, int]]:
    """How many intervals of each quantity cover the mean of all data sets, and of how many."""
    counts = {}
    for key in QUANTITIES:
        values = np.array([one[key] for one in found])
        truth = values[:, :, 0].mean(axis=0)
        inside = (values[:, :, 1] <= truth) & (truth <= values[:, :, 2])
        counts[key] = int(inside.sum()), inside.size
    return counts


def main() -> None:
    """Runs the study and writes its table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data-sets", type=int, default=200)
    options = parsed(parser, BLOCK)
    results: dict[Design, list[_Found]] = {design: [] for design in DESIGNS}
    with processes() as pool:
        jobs = list(product(DESIGNS, range(1, options.data_sets + 1)))
        running = [pool.submit(measured, *job) for job in jobs]
        for (design, _), one in zip(jobs, until_interrupted("Data sets", [job.result for job in running])):  # noqa: B905
            results[design].append(one)
    rows = {design.name: coverage(found) for design, found in results.items() if found}
    write_json(BLOCK, rows)
    text = table(
        ("left out", *TITLES),
        [[name, *(share_interval(*counts[key]) for key in QUANTITIES)] for name, counts in rows.items()],
    )
    print(text)
    write_block(options.document, BLOCK, text)


if __name__ == "__main__":
    main()
