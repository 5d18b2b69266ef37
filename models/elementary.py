"""Exponential and logarithm of compiled loops, of few operations and without branches, so that vectors take them.

The relative error of a logarithm is at most 4e-16, that of an exponential at most (4 + |x|) 1e-16.
"""

import math
from decimal import Decimal

import numpy as np

from .compiled import compiled, polynomial, power_of_two

LEAST = -708.0
"""Exponents below it leave the range of float64."""
_PER_LOG_TWO = 1 / math.log(2)
_LOG_TWO_HIGH = math.ldexp(round(math.ldexp(math.log(2), 32)), -32)  # its products with exponents are exact
_LOG_TWO_LOW = float(Decimal("0.693147180559945309417232121458") - Decimal(_LOG_TWO_HIGH))
_ROOT_HALF = int(np.float64(math.sqrt(0.5)).view(np.int64))
_exponential = polynomial([1 / math.factorial(n) for n in range(13, -1, -1)])
_logarithm = polynomial([2 / (2 * n + 3) for n in range(8, -1, -1)])  # 2 artanh(s) / s - 2 over s^2


@compiled
def exponential(x):
    """Exponential of x, at least `LEAST`."""
    n = math.floor(x * _PER_LOG_TWO + 0.5)
    return _exponential((x - n * _LOG_TWO_HIGH) - n * _LOG_TWO_LOW) * power_of_two(np.int64(np.int32(n)))


@compiled
def logarithm(x):
    """Logarithm of x, which is at least the smallest normal number."""
    word = np.float64(x).view(np.int64)
    n = (word - _ROOT_HALF) >> 52
    f = np.int64(word - (n << 52)).view(np.float64) - 1  # from sqrt(1/2) - 1 to sqrt(2) - 1
    return _sum(f, f / (2 + f), np.float64(np.int32(n)))


@compiled
def log_one_plus(x):
    """Logarithm of 1 + x, with x of at least 0."""
    word = np.float64(1 + x).view(np.int64)
    n = (word - _ROOT_HALF) >> 52
    f = x if n == 0 else np.int64(word - (n << 52)).view(np.float64) - 1
    return _sum(f, f / (2 + f), np.float64(np.int32(n)))


@compiled
def _sum(f, s, n):
    z = s * s
    return n * _LOG_TWO_HIGH + (f - (s * (f - z * _logarithm(z)) - n * _LOG_TWO_LOW))
