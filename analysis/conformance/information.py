"""Expected information of the next tap in exact arithmetic: which of a pool of taps comes, and what that tells.

It shares no code with the engines; the rules stand in docs/reference/conformance/README.md.
"""

from collections.abc import Iterable, Sequence
from itertools import product

from .arithmetic import MP, Matrix, Number

STRATEGIES = ("info-what", "info-where", "info-joint")
"""Strategies that move to where the next tap is expected to tell most, about the object, the position or both."""
EQUAL = MP.mpf(10) ** -40
"""Information that differs by less, in nats, is equal but for the rounding here."""

type Outcomes = list[list[list[Number] | None]]
"""P(tap | class) over the taps of the pool, [L][M][N]; `None` where no tap is possible."""


def outcomes(log_likelihoods: Sequence[Matrix]) -> Outcomes:
    """The taps of a pool as possible outcomes, from their log-likelihoods [N][L][M]."""
    L, M = len(log_likelihoods[0]), len(log_likelihoods[0][0])
    return [[_shares([taps[l][m] for taps in log_likelihoods]) for m in range(M)] for l in range(L)]


def _shares(logs: list[Number]) -> list[Number] | None:
    top = max(logs)
    if top == MP.ninf:
        return None
    weights = [MP.exp(value - top) for value in logs]
    total = MP.fsum(weights)
    return [weight / total for weight in weights]


def information(given: Outcomes, belief: Matrix, strategy: str) -> Number:
    """Mutual information of the next tap and the object, the position or the class, in nats; belief after the move."""
    known = {
        (l, m): belief[l][m]
        for l, m in product(range(len(belief)), range(len(belief[0])))
        if given[l][m] is not None and belief[l][m] > 0
    }
    total = MP.fsum(known.values())
    if not total > 0:
        return MP.mpf(0)
    groups: dict[object, list[tuple[int, int]]] = {}
    for l, m in known:
        groups.setdefault({"info-what": m, "info-where": l}.get(strategy, (l, m)), []).append((l, m))
    shares = {cell: p / total for cell, p in known.items()}
    mixed = [(MP.fsum(shares[c] for c in cells), _mixture(given, shares, cells)) for cells in groups.values()]
    left = MP.fsum(weight * _entropy(p / weight for p in taps) for weight, taps in mixed)
    return _entropy(MP.fsum(column) for column in zip(*(taps for _, taps in mixed), strict=True)) - left


def _mixture(given: Outcomes, shares: dict[tuple[int, int], Number], cells: list[tuple[int, int]]) -> list[Number]:
    """Probability of each tap together with a group of classes."""
    rows = [[shares[l, m] * p for p in given[l][m] or ()] for l, m in cells]
    return [MP.fsum(column) for column in zip(*rows, strict=True)]


def _entropy(probabilities: Iterable[Number]) -> Number:
    return -MP.fsum(p * MP.log(p) for p in probabilities if p > 0)


def best_move(values: Sequence[Number], here: int) -> int:
    """The move to the position of the largest value; of equal ones the shortest, of equally long ones to the lower."""
    top = max(values)
    moves = [l - here for l, value in enumerate(values) if value >= top - EQUAL]
    return min(moves, key=lambda move: (abs(move), move))
