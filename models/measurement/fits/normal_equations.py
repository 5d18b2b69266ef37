"""Compiled loops for many small systems of normal equations."""

import numpy as np

from ...compiled import compiled


@compiled
def solve(vector, matrix, root):
    """Solves n systems of D equations with a positive definite matrix each.

    Args:
        vector: Right-hand sides, shape (n, D); receives the solutions.
        matrix: Shape (n, D, D); receives the inverses, plus the products of the solutions with themselves.
        root: Receives upper triangular factors of the inverses, which these times their transposes are, (n, D, D).
    """
    n, D = vector.shape
    factor, part = np.empty((D, D)), np.empty(D)
    for c in range(n):
        own, inverse, solution = root[c], matrix[c], vector[c]
        _factorise(inverse, factor)
        _invert(factor, own)
        part[:] = 0.0
        for i in range(D):
            for j in range(i, D):
                part[j] += own[i, j] * solution[i]
        for i in range(D):
            total = 0.0
            for j in range(i, D):
                total += own[i, j] * part[j]
            solution[i] = total
        for i in range(D):
            for j in range(i, D):
                total = 0.0
                for k in range(j, D):
                    total += own[i, k] * own[j, k]
                inverse[i, j] = inverse[j, i] = total + solution[i] * solution[j]


@compiled
def _factorise(matrix, factor):
    """Writes the transposed Cholesky factor of a matrix above and on the diagonal of `factor`."""
    D = len(matrix)
    for i in range(D):
        for j in range(i, D):
            factor[i, j] = matrix[i, j]
    for i in range(D):
        per_pivot = 1 / np.sqrt(factor[i, i])
        for j in range(i, D):
            factor[i, j] *= per_pivot
        for k in range(i + 1, D):
            for j in range(k, D):
                factor[k, j] -= factor[i, k] * factor[i, j]


@compiled
def _invert(factor, inverse):
    """Writes the inverse of an upper triangular matrix, with zeros below the diagonal."""
    D = len(factor)
    for i in range(D - 1, -1, -1):
        inverse[i] = 0.0
        for k in range(i + 1, D):
            for j in range(k, D):
                inverse[i, j] -= factor[i, k] * inverse[k, j]
        inverse[i, i] = 1.0
        for j in range(i, D):
            inverse[i, j] /= factor[i, i]
