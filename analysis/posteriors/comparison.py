"""The verdict on draws of a program: whether means and variances are those of the reference posterior.

Each mean, and the logarithm of each mean squared distance from the reference mean, is compared in units of its Monte
Carlo standard error, that of the reference included. How widely single draws spread is taken from the reference, as
draws that happen to spread little would seem too exact; how many independent draws they are worth is estimated. The
largest of all differences must be below the limit under which that of right draws is in 99 of 100 programs
(Bonferroni); `benchmarks.posteriors.level` measures how often.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from ...models.errors import InputError, counted, shortened
from .catalogue import VERSION, Number, ReferencePosterior
from .files import Draws
from .quantities import on_scale

LEVEL = 0.01
"""Share of right programs that are called wrong, at most."""
R_HAT, ESS = 1.05, 400.0
"""Largest R-hat and smallest effective sample size of draws that can be judged."""

_SHOWN, _FEWEST = 10, 4


class MomentDifference(NamedTuple):
    """How far one moment of draws is from that of the reference.

    Attributes:
        name: Of the number.
        scale: On which it is compared.
        moment: `mean` or `variance`.
        value: Of the draws.
        right: Of the reference.
        z: Difference in standard errors.
    """

    name: str
    scale: str
    moment: str
    value: float
    right: float
    z: float

    @property
    def sentence(self) -> str:
        """The difference in words."""
        what = {"identity": self.name, "log": f"log {self.name}"}.get(self.scale, f"({self.name} {self.scale})")
        return (
            f"the {self.moment} of {what} is {self.value:.4g} instead of {self.right:.4g}, {abs(self.z):.1f} standard "
            "errors away"
        )


class DrawsVerdict(NamedTuple):
    """The verdict on draws.

    Attributes:
        name: Of the reference posterior.
        differences: Of all moments, the largest first.
        limit: Largest size of `z` that passes.
        r_hat: The largest of any number; NaN for one chain.
        ess: The smallest effective sample size.
        unmixed: Name of the number with too large an R-hat or too small a sample size; empty if there is none.
    """

    name: str
    differences: tuple[MomentDifference, ...]
    limit: float
    r_hat: float
    ess: float
    unmixed: str

    def __repr__(self) -> str:
        return "\n".join(self.sentences)

    @property
    def status(self) -> str:
        """`pass`, `differs`, or `undecided` where the chains have not mixed."""
        if self.unmixed:
            return "undecided"
        return "differs" if abs(self.differences[0].z) > self.limit else "pass"

    @property
    def sentences(self) -> list[str]:
        """What was found, in lines."""
        name = f"{self.name}, reference {VERSION}"
        mixed = f"worst R-hat {self.r_hat:.3f}, least effective sample size {self.ess:.0f}"
        if self.unmixed and self.r_hat > R_HAT:
            return [f"{name}: UNDECIDED; {self.unmixed} has not mixed: {mixed}; R-hat may be {R_HAT} at most."]
        if self.unmixed:
            return [f"{name}: UNDECIDED; too few draws, of {self.unmixed}: {mixed}, which must be {ESS:.0f}."]
        over = [one for one in self.differences if abs(one.z) > self.limit]
        head = f"{name}: {'DIFFERS' if over else 'pass'}; {len(self.differences)} moments, largest difference "
        head += f"{abs(self.differences[0].z):.1f} standard errors (at most {self.limit:.1f}); {mixed}."
        more = [f"  ... and {len(over) - _SHOWN} more"] if len(over) > _SHOWN else []
        return [head, *(f"  {one.sentence}" for one in over[:_SHOWN]), *more]


def compare_draws(reference: ReferencePosterior, draws: Draws) -> DrawsVerdict:
    """The verdict on draws.

    Args:
        reference: What they should be of.
        draws: Numbers by name, shape (chain, draw); further ones are ignored.

    Raises:
        InputError: A number is missing or not finite, there are less than four draws, or two chains are the same.
    """
    scaled = {number: _scaled(number, draws) for number in reference.numbers}
    chains = np.stack([*scaled.values()], axis=1)
    if len(np.unique(chains.reshape(len(chains), -1), axis=0)) < len(chains):
        raise InputError("Two chains have the same draws; each must be run with random numbers of its own.")
    differences = [one for number, values in scaled.items() for one in _differences(number, values)]
    limit = float(norm.isf(LEVEL / (2 * len(differences))))
    mixing = {number.name: _mixing(values) for number, values in scaled.items()}
    worst = max(mixing, key=lambda name: (not _mixed(*mixing[name]), -mixing[name][1]))
    r_hat, ess = mixing[worst]
    return DrawsVerdict(
        reference.name,
        tuple(sorted(differences, key=lambda one: -abs(one.z))),
        limit,
        max(r_hat, *(found[0] for found in mixing.values())),
        min(found[1] for found in mixing.values()),
        "" if _mixed(r_hat, ess) else worst,
    )


def _mixed(r_hat: float, ess: float) -> bool:
    """Whether draws can be judged; NaN is the R-hat of equal draws, and the sample size of ones too large to square."""
    return ess >= ESS and not r_hat > R_HAT


def _scaled(number: Number, draws: Draws) -> NDArray[np.float64]:
    if number.name not in draws:
        chains, per_chain = next(iter(draws.values()), np.empty((0, 0))).shape
        sizes = f"{counted(chains, 'chain')} of {counted(per_chain, 'draw')}"
        only = f", only {shortened([*draws], 8)}" if draws else ""
        raise InputError(f"The draws, {sizes}, have no number {number.name}{only}.")
    values = draws[number.name]
    if len(values) < 1 or values.shape[1] < _FEWEST:
        held = f"{counted(len(values), 'chain')} of {counted(values.shape[1], 'draw')}"
        raise InputError(f"Draws of {number.name} are too few: {held}; at least one chain of {_FEWEST} draws is due.")
    _check(number.name, "finite", values, np.isfinite(values))
    scaled = on_scale(values, number.scale)
    _check(number.name, "positive, as they are compared as logarithms", values, np.isfinite(scaled))
    return scaled


def _check(name: str, wanted: str, values: NDArray[np.float64], fine: NDArray[np.bool_]) -> None:
    if not fine.all():
        chain, draw = np.argwhere(~fine)[0]
        raise InputError(
            f"Draws of {name} must be {wanted}; draw {draw + 1} of chain {chain + 1} is {values[chain, draw]:g}."
        )


def _differences(number: Number, values: NDArray[np.float64]) -> list[MomentDifference]:
    mean = float(values.mean())
    own = (number.variance / _effective(values)) ** 0.5
    z = (mean - number.mean) / float(np.hypot(own, number.mcse_mean))
    found = [MomentDifference(number.name, number.scale, "mean", mean, number.mean, z)]
    if number.scale.startswith("is "):
        return found  # the variance of a class follows from its mean
    square = (values - number.mean) ** 2
    variance = float(square.mean())
    error = float(np.hypot(number.sd_square / _effective(square) ** 0.5, number.mcse_variance)) / number.variance
    z = float(np.log(max(variance, np.finfo(float).tiny) / number.variance)) / error
    z = float("inf") if np.isnan(z) else z  # the squares of draws are too large for their sample size
    return [*found, MomentDifference(number.name, number.scale, "variance", variance, number.variance, z)]


def _effective(values: NDArray[np.float64]) -> float:
    """How many independent draws the mean of these is worth."""
    import arviz as az  # noqa: PLC0415 - it takes long to import

    return float(az.ess(values, method="mean"))


def _mixing(values: NDArray[np.float64]) -> tuple[float, float]:
    """R-hat, 1 for one chain, and effective sample size."""
    import arviz as az  # noqa: PLC0415 - it takes long to import

    return float(az.rhat(values)) if len(values) > 1 else 1.0, _effective(values)
