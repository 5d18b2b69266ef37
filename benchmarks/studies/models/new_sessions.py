"""Error of the log evidence of taps of a new session against exact integrals, and what fits say of it.

What belongs to a session is a number of independent normal shifts. The taps of an episode tell each with a normal
error, so the evidence is known exactly.

`--document docs/explanation/model-studies.md` updates the table of that page.
"""

import argparse
from collections.abc import Sequence
from functools import partial
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import numpyro
import numpyro.distributions as dist
from numpy.typing import NDArray
from solidtouch.models.measurement.generic.contract import StoryCall, StoryFunction
from solidtouch.models.measurement.generic.runs import Program
from solidtouch.models.measurement.generic.session_draws import error_of_mean
from solidtouch.models.measurement.generic.sessions import in_new_sessions, session_points
from solidtouch.models.measurement.generic.structure import structure_of
from solidtouch.models.seeds import Purpose, generator

from benchmarks.page import parsed, table, write_block
from benchmarks.study import until_interrupted, write_json

SHIFTS = (1, 2, 4, 8)
RATIOS = (1.0, 3.0, 10.0)
"""Standard deviation of a shift in the prior over that of the error with which an episode tells it."""
DRAWS = (128, 512, 2048)
FAR = 3.0
"""Standard deviations of the prior."""
_EPISODES = 12


class Errors(NamedTuple):
    """Mean errors over episodes, in nats.

    Attributes:
        shifts: Number of shifts of a session.
        far: Whether the first shift is `FAR` out.
        ratio: One of `RATIOS`.
        draws: Number of draws.
        error: That of the log evidence.
        said: What `error_of_mean` says of it.
    """

    shifts: int
    far: bool
    ratio: float
    draws: int
    error: float
    said: float


def shifted(where: Any, what: Any, taps: Any = None, *, J: int, K: int, session: Any) -> None:  # noqa: ARG001
    """A standard normal shift of each session and taxel."""
    with numpyro.plate("S", int(session.max()) + 1, dim=-2), numpyro.plate("K", K, dim=-1):
        shift: Any = numpyro.sample("shift", dist.Normal(0.0, 1.0))
    with numpyro.plate("tap", len(where), dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("taxel", K, dim=-1):
        numpyro.sample("taps", dist.Normal(shift[session][:, None], 1.0), obs=taps)


def new_shifts(program: Program, draws: int, repetition: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Shifts of new sessions, shape (draws, shifts), and their log weights, shape (draws,)."""
    known = {"shift": np.zeros((program.sessions, program.batch.shape[3]))}
    own = [generator(repetition, Purpose.NEW_SESSION, number) for number in range(draws)]
    points, log_weight = session_points(program, known, draws, own[0], tails=True)
    return np.stack([one["shift"][-1] for one in in_new_sessions(program, [known] * draws, own, points)]), log_weight


def errors(
    shifts: int, repetition: int, ratios: Sequence[float] = RATIOS, draws: Sequence[int] = DRAWS
) -> list[Errors]:
    """Errors of one repetition with each number of draws."""
    none = np.zeros(0, dtype=np.intp)
    batch = StoryCall(none, none, (1, 1, 1, shifts), np.zeros(1), session=none)
    story = StoryFunction.of(shifted, "shifted")
    program = Program(story, structure_of(story, batch), batch, 1)
    most, weight = new_shifts(program, max(draws), repetition)  # the first ones are those of fewer draws
    rng, found = generator(repetition, Purpose.STUDY, shifts), []
    for far, ratio in product((False, True), ratios):
        told = rng.normal(size=(_EPISODES, shifts)) * np.sqrt(1 + ratio**-2)
        if far:
            told[:, 0] = FAR
        exact = -0.5 * (np.log1p(ratio**2) + told**2 / (1 + ratio**-2)).sum(axis=1)
        likely = -0.5 * ratio**2 * ((most[:, None] - told) ** 2).sum(axis=2)
        for number in draws:
            log_mean = np.logaddexp.reduce(weight[:number]) - np.log(number)
            log_weight = likely[:number] + weight[:number, None] - log_mean
            off = np.logaddexp.reduce(log_weight, axis=0) - np.log(number) - exact
            found.append(Errors(shifts, far, ratio, number, np.abs(off).mean(), error_of_mean(log_weight)))
    return found


def shown(results: Sequence[Errors]) -> str:
    """Median errors and what is said, a line for each number of shifts, first shift and ratio."""
    lines = []
    for shifts, far, ratio in dict.fromkeys((one.shifts, one.far, one.ratio) for one in results):
        cells = []
        for number in dict.fromkeys(one.draws for one in results):
            own = [one for one in results if one[:4] == (shifts, far, ratio, number)]
            error, said = (np.median([getattr(one, name) for one in own]) for name in ("error", "said"))
            cells.append(f"{_short(error)} / {_short(said)}")
        lines.append([str(shifts), f"{FAR:g} sd out" if far else "drawn", f"{ratio:g}", *cells])
    numbers = [f"{number} draws" for number in dict.fromkeys(one.draws for one in results)]
    return table(["shifts", "first shift", "ratio", *numbers], lines)


def _short(error: float) -> str:
    return f"{error:.1g}" if error < 1 else f"{error:.1f}" if error < 10 else f"{error:.0f}"


def within(results: Sequence[Errors]) -> str:
    """How what is said goes with the errors, as a sentence."""
    low, middle, high = np.quantile([one.said / one.error for one in results if one.error > 0.01], [0.05, 0.5, 0.95])
    return (
        f"Where the error is above 0.01 nats, what is said of it is {middle:.2g} times as large in the median, "
        f"{low:.2g} to {high:.2g} times in nine of ten repetitions."
    )


def main() -> None:
    """Runs the study as the command line says."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repetitions", type=int, default=40, help="scramblings of the draws")
    options = parsed(parser, "new-sessions")
    tasks = [partial(errors, shifts, number) for shifts in SHIFTS for number in range(options.repetitions)]
    results = [one for part in until_interrupted("New sessions", tasks) for one in part]
    if not results:
        return
    write_json("new-sessions", [one._asdict() for one in results])
    text = f"{shown(results)}\n\nMedians of {options.repetitions} repetitions. {within(results)}"
    print(text)
    if len(results) == 2 * len(tasks) * len(RATIOS) * len(DRAWS):
        write_block(options.document, "new-sessions", text)


if __name__ == "__main__":
    main()
