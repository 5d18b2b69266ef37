"""Compiled loops for the probability of intervals under Student's t.

With h = (freedom - 1) / 2 the upper tail at x >= 0 is Q(x) = g(x) / (1 + x) * (1 + x^2 / freedom)^-h, where g hardly
varies: a polynomial in t = (x - pivot) / (x + pivot) gives it for every x. Its coefficients follow from the continued
fraction F of the incomplete beta function, I_z(a, b) = z^a (1 - z)^b / (a B(a, b)) F (DLMF 8.17.22), once for each
number of degrees of freedom: with z = freedom / (freedom + x^2) in the tail and 1 - z near 0, as these converge fast on
their side of x^2 = 3. The relative error of Q is 1e-12, that of an interval this over its share of the tail; above 1e4
degrees of freedom both grow in proportion to these.
"""

import math
from functools import lru_cache

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial
from numpy.typing import NDArray

from ...compiled import compiled
from ...elementary import LEAST, exponential, log_one_plus, logarithm

LEAST_FREEDOM = 0.5
"""Degrees of freedom from which on the polynomial is accurate."""
_DEGREE = 35
_NODES = np.cos(np.pi * (np.arange(_DEGREE + 1) + 0.5) / (_DEGREE + 1))
_INTERPOLATED = np.polynomial.chebyshev.chebvander(_NODES, _DEGREE) * np.r_[1.0, np.full(_DEGREE, 2.0)] / (_DEGREE + 1)
_POWERS = np.array(
    [np.pad(Chebyshev.basis(n).convert(kind=Polynomial).coef, (0, _DEGREE - n)) for n in range(_DEGREE + 1)]
)
_MIDDLE = math.sqrt(3.0)
_ROUNDS = 100_000
_AT_ONCE = 256  # intervals of one number of degrees of freedom that are computed together, so that they stay in cache
_FAR = 1e100  # counts as infinity
_TINY = np.finfo(np.float64).tiny


def tails(freedom: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Pivots, shape (F,), and coefficients of g, highest powers first, shape (F, 36), for degrees of freedom (F,)."""
    return _known_tails(freedom.astype(np.float64).tobytes())


@lru_cache(maxsize=16)
def _known_tails(content: bytes) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    freedom = np.frombuffer(content).copy()  # compiled loops take arrays that may change
    pivot = 5.3 * np.sqrt(freedom / (freedom + 28))
    x = pivot[:, np.newaxis] * (1 + _NODES) / (1 - _NODES)
    values = np.empty_like(x)
    _scaled_tails(freedom, x, values)
    return pivot, np.ascontiguousarray((values @ _INTERPOLATED @ _POWERS)[:, ::-1])


@compiled
def _scaled_tails(freedom, x, out):
    """Writes g for F degrees of freedom at x (F, n) to `out` (F, n)."""
    for f in range(len(freedom)):
        v = freedom[f]
        # Integrals of (1 + x^2 / v)^(-(v + 1) / 2) from 0 to the middle and from there on are half of the whole.
        scale = 0.5 / (_upto(_MIDDLE, v) + _beyond(_MIDDLE, v) * math.exp(-0.5 * (v - 1) * math.log1p(_MIDDLE**2 / v)))
        for i in range(x.shape[1]):
            z = x[f, i]
            if z > _MIDDLE:
                out[f, i] = (1 + z) * scale * _beyond(z, v)
            else:
                rest = 0.5 - scale * _upto(z, v)
                out[f, i] = (1 + z) * rest * math.exp(0.5 * (v - 1) * math.log1p(z * z / v))


@compiled
def _upto(x, v):
    """Integral of (1 + u^2 / v)^(-(v + 1) / 2) from 0 to x."""
    y = x * x / (v + x * x)
    return math.sqrt(v * y) * math.exp(-0.5 * v * math.log1p(x * x / v)) * _fraction(0.5, 0.5 * v, y)


@compiled
def _beyond(x, v):
    """Integral of (1 + u^2 / v)^(-(v + 1) / 2) from x on, over (1 + x^2 / v)^(-(v - 1) / 2)."""
    return 1 / (x + v / x) * _fraction(0.5 * v, 0.5, v / (v + x * x))


@compiled
def _fraction(a, b, z):
    """Continued fraction F, by Lentz's method."""
    c, d = 1.0, 1 / (1 - (a + b) * z / (a + 1))
    value = d
    for m in range(1, _ROUNDS):
        even = m * (b - m) * z / ((a - 1 + 2 * m) * (a + 2 * m))
        d, c = 1 / (1 + even * d), 1 + even / c
        value *= d * c
        odd = -(a + m) * (a + b + m) * z / ((a + 2 * m) * (a + 1 + 2 * m))
        d, c = 1 / (1 + odd * d), 1 + odd / c
        value *= d * c
        if abs(d * c - 1) < 2e-16:
            break
    return value


@compiled
def log_probabilities(lower, upper, group, freedom, pivot, coefficients, out):
    """Writes the log probability of each interval, -inf where rounding has left no width, NaN where an end is.

    Args:
        lower: Lower ends, shape (n,).
        upper: Upper ends, shape (n,).
        group: Which degrees of freedom each has, shape (n,).
        freedom: Degrees of freedom, shape (F,).
        pivot: See `tails`.
        coefficients: See `tails`.
        out: Receives the result, shape (n,).
    """
    F, n = len(freedom), len(lower)
    first, order = np.zeros(F + 1, dtype=np.int64), np.empty(n, dtype=np.int64)
    for i in range(n):
        first[group[i] + 1] += 1
    for f in range(F):
        first[f + 1] += first[f]
    place = first.copy()
    for i in range(n):
        order[place[group[i]]] = i
        place[group[i]] += 1
    room = np.empty((6, _AT_ONCE))
    for f in range(F):
        for start in range(first[f], first[f + 1], _AT_ONCE):
            own = order[start : min(start + _AT_ONCE, first[f + 1])]
            a, b = room[0, : len(own)], room[1, : len(own)]
            for i in range(len(own)):
                a[i], b[i] = lower[own[i]], upper[own[i]]
            _some(a, b, freedom[f], pivot[f], coefficients[f], room)
            for i in range(len(own)):
                out[own[i]] = a[i] if lower[own[i]] <= upper[own[i]] else np.nan


@compiled
def _some(a, b, freedom, pivot, coefficients, room):
    """Replaces lower ends `a` by log probabilities, see `log_probabilities`; `b` changes as well."""
    n, h, per_freedom = len(a), 0.5 * (freedom - 1), 1 / freedom
    near, inner, outer, place = room[2, :n], room[3, :n], room[4, :n], room[5, :n]
    for i in range(n):
        low, high = max(a[i], -_FAR), min(b[i], _FAR)
        mirrored = low + high < 0  # to the side where tails are small and nothing is lost in their difference
        a[i] = -high if mirrored else low
        b[i] = -low if mirrored else high
    for i in range(n):
        near[i] = abs(a[i])
    _tails(near, pivot, coefficients, place, inner)
    _tails(b, pivot, coefficients, place, outer)
    for i in range(n):
        at = max(a[i], 0.0)
        drop = -h * log_one_plus((b[i] - at) * (b[i] + at) / (freedom + at * at))
        rest = outer[i] * exponential(min(max(drop, LEAST), 700.0))
        outer[i] = rest if b[i] < _FAR else 0.0
    for i in range(n):
        fall = -h * log_one_plus(near[i] * near[i] * per_freedom)
        inside = 1 - inner[i] * exponential(min(max(fall, LEAST), 700.0))
        width = (inner[i] if a[i] >= 0 else inside) - outer[i]
        value = logarithm(max(width, _TINY)) + (fall if a[i] >= 0 else 0.0)
        a[i] = value if width > 0 else -np.inf


@compiled
def _tails(x, pivot, coefficients, place, out):
    """Writes g / (1 + x) for x of at least 0 to `out`; `place` is room for as many numbers."""
    for i in range(len(x)):
        out[i] = coefficients[0]
        place[i] = (x[i] - pivot) / (x[i] + pivot)
    for k in range(1, _DEGREE, 5):
        c0, c1, c2, c3 = coefficients[k], coefficients[k + 1], coefficients[k + 2], coefficients[k + 3]
        c4 = coefficients[k + 4]
        for i in range(len(x)):
            t = place[i]
            out[i] = ((((out[i] * t + c0) * t + c1) * t + c2) * t + c3) * t + c4
    for i in range(len(x)):
        out[i] /= 1 + x[i]
