"""Compiled loops for many small systems of normal equations, solved in blocks so that vector instructions take them."""

import numpy as np

from ...compiled import compiled

_AT_ONCE = 128  # systems of a block


@compiled
def expect(precision, gram, product, square, tight, weight, second, root, rest):
    """Regressions of L classes on D functions for n outcomes of each of M objects, with normal priors around 0.

    Args:
        precision: Of the noise, shape (L, M, n).
        gram: Gram matrices of the functions, shape (M, L, D, D).
        product: Sums of products of functions and outcomes, shape (M, L, D, n).
        square: Sums of squared outcomes, shape (L, M, n).
        tight: Prior precisions of the weights, shape (D, n).
        weight: Receives expected weights, shape (M, D, n).
        second: Receives their expected squares, shape (M, D, n).
        root: Receives upper triangular factors of their covariances, which these times their transposes are; what is
            below the diagonal stays, shape (M, D, D, n).
        rest: Receives expected sums of squared residuals, shape (L, M, n).
    """
    L, M, n = precision.shape
    D, wide = len(tight), min(_AT_ONCE, n)
    matrix, inverse = np.ones((D, D, _AT_ONCE)), np.empty((D, D, _AT_ONCE))
    noise, outcome = np.ones((L, _AT_ONCE)), np.zeros((L, D, _AT_ONCE))
    vector, part, total = np.empty((D, _AT_ONCE)), np.empty((D, _AT_ONCE)), np.empty(_AT_ONCE)
    for m in range(M):
        for start in range(0, n, _AT_ONCE):
            first = min(start, n - wide)  # the last blocks overlap
            for l in range(L):
                for i in range(wide):
                    noise[l, i] = precision[l, m, first + i]
                for d in range(D):
                    for i in range(wide):
                        outcome[l, d, i] = product[m, l, d, first + i]
            _gather(noise, outcome, gram[m], tight[:, first : first + wide], matrix, vector)
            _factorise(matrix)
            _invert(matrix, inverse)
            _solve(inverse, vector, part)
            _square(inverse, vector, matrix)
            for d in range(D):
                for i in range(wide):
                    weight[m, d, first + i], second[m, d, first + i] = vector[d, i], matrix[d, d, i]
                for e in range(d, D):
                    for i in range(wide):
                        root[m, d, e, first + i] = inverse[d, e, i]
            for l in range(L):
                _expected(outcome[l], gram[m, l], vector, matrix, total)
                for i in range(wide):
                    rest[l, m, first + i] = max(square[l, m, first + i] + 2 * total[i], 0.0)


@compiled
def _gather(noise, outcome, gram, tight, matrix, vector):
    """Writes the left- and right-hand sides."""
    D = len(vector)
    for d in range(D):
        right = vector[d]
        for i in range(_AT_ONCE):
            right[i] = 0.0
        for l in range(len(noise)):
            a, b = noise[l], outcome[l, d]
            for i in range(_AT_ONCE):
                right[i] += a[i] * b[i]
        for e in range(d, D):
            left = matrix[d, e]
            for i in range(_AT_ONCE):
                left[i] = 0.0
            for l in range(len(noise)):
                number, a = gram[l, d, e], noise[l]
                for i in range(_AT_ONCE):
                    left[i] += number * a[i]
        for i in range(tight.shape[1]):
            matrix[d, d, i] += tight[d, i]
        for i in range(tight.shape[1], _AT_ONCE):
            matrix[d, d, i] += 1.0


@compiled
def _factorise(matrix):
    """Replaces what stands on and above the diagonal by the transposed Cholesky factor."""
    D = len(matrix)
    for i in range(D):
        pivot = matrix[i, i]
        for n in range(_AT_ONCE):
            pivot[n] = np.sqrt(pivot[n])
        for j in range(i + 1, D):
            row = matrix[i, j]
            for n in range(_AT_ONCE):
                row[n] /= pivot[n]
        for k in range(i + 1, D):
            a = matrix[i, k]
            for j in range(k, D):
                b, row = matrix[i, j], matrix[k, j]
                for n in range(_AT_ONCE):
                    row[n] -= a[n] * b[n]


@compiled
def _invert(factor, inverse):
    """Writes the inverse of an upper triangular matrix on and above the diagonal."""
    D = len(factor)
    for i in range(D - 1, -1, -1):
        pivot, own = factor[i, i], inverse[i, i]
        for n in range(_AT_ONCE):
            own[n] = 1 / pivot[n]
        for j in range(i + 1, D):
            row = inverse[i, j]
            for n in range(_AT_ONCE):
                row[n] = 0.0
            for k in range(i + 1, j + 1):
                a, b = factor[i, k], inverse[k, j]
                for n in range(_AT_ONCE):
                    row[n] -= a[n] * b[n]
            for n in range(_AT_ONCE):
                row[n] *= own[n]


@compiled
def _solve(root, vector, part):
    """Replaces right-hand sides by solutions; `part` is room."""
    D = len(vector)
    for j in range(D):
        row = part[j]
        for n in range(_AT_ONCE):
            row[n] = 0.0
        for i in range(j + 1):
            a, b = root[i, j], vector[i]
            for n in range(_AT_ONCE):
                row[n] += a[n] * b[n]
    for i in range(D):
        row = vector[i]
        for n in range(_AT_ONCE):
            row[n] = 0.0
        for j in range(i, D):
            a, b = root[i, j], part[j]
            for n in range(_AT_ONCE):
                row[n] += a[n] * b[n]


@compiled
def _square(root, vector, matrix):
    """Writes covariances plus products of solutions on and above the diagonal."""
    D = len(vector)
    for i in range(D):
        for j in range(i, D):
            row, a, b = matrix[i, j], vector[i], vector[j]
            for n in range(_AT_ONCE):
                row[n] = a[n] * b[n]
            for k in range(j, D):
                a, b = root[i, k], root[j, k]
                for n in range(_AT_ONCE):
                    row[n] += a[n] * b[n]


@compiled
def _expected(outcome, gram, vector, matrix, total):
    """Writes half of what the squared residuals of a class differ by from its squares."""
    D = len(vector)
    for n in range(_AT_ONCE):
        total[n] = 0.0
    for i in range(D):
        a, b = outcome[i], vector[i]
        for n in range(_AT_ONCE):
            total[n] -= a[n] * b[n]
        for j in range(i, D):
            number, a = (0.5 if j == i else 1.0) * gram[i, j], matrix[i, j]
            for n in range(_AT_ONCE):
                total[n] += number * a[n]
