"""Answers to the conformance cases in Python without any library: `python3 solid.py < kit/root-j.jsonl`.

README.md beside this file defines what is read and written. Beliefs are logarithms, so that none is too small.
"""

import json
import sys
from bisect import bisect_right
from math import erfc, exp, fsum, inf, log, log1p, pi, sqrt


def log_sum(logs):
    """Log of the sum of numbers given by their logarithms."""
    top = max(logs, default=-inf)
    return top + log(fsum(exp(x - top) for x in logs)) if top > -inf else -inf


def log_tail(x):
    """Log of the probability that a standard normal number exceeds x; a continued fraction where that is tiny."""
    if x < 30:
        return log(erfc(x / sqrt(2)) / 2)
    rest = x
    for n in range(60, 0, -1):
        rest = x + n / rest
    return -x * x / 2 - log(2 * pi) / 2 - log(rest)


def log_interval(low, high):
    """Log of the probability that a standard normal number lies in an interval."""
    if low + high > 0:
        low, high = -high, -low
    most = log_tail(-high)
    return most if low == -inf else most + log1p(-exp(log_tail(-low) - most))


class Case:
    """A case: its tables, and the belief so far."""

    def __init__(self, header):
        self.given = header
        self.L, self.M, self.K, self.J, self.B = (header[size] for size in "LMKJB")
        self.power = {"J": 1 / self.J, "JK": 1 / (self.J * self.K), "none": 1.0}.get(header["power"], header["power"])
        self.range = equal_bins(header["training"]["taps"], self.B) if "training" in header else header["edges"]
        self.edges = self.range if isinstance(self.range[0], list) else [self.range] * self.K
        self.counts = self.count(**header["training"]) if "training" in header else header.get("counts")
        self.log_p = [[[self.table(l, m, k) for k in range(self.K)] for m in range(self.M)] for l in range(self.L)]
        known = header.get("probabilities", [[[[1]]] * self.M] * self.L)
        self.trained = [[l for l in range(self.L) if any(map(any, known[l][m]))] for m in range(self.M)]
        self.belief = [[log(p) if p else -inf for p in row] for row in header["prior"]]
        pool = [self.log_likelihood(tap) for tap in header.get("pool", ())]
        self.pool = [[shares([tap[l][m] for tap in pool]) for m in range(self.M)] for l in range(self.L)]

    def count(self, taps, where, what):
        """Histograms of training taps."""
        counts = [[[[0] * self.B for _ in range(self.K)] for _ in range(self.M)] for _ in range(self.L)]
        for tap, l, m in zip(taps, where, what, strict=True):
            for sample in tap:
                for k, value in enumerate(sample):
                    counts[l][m][k][self.bin(value, k)] += 1
        return counts

    def bin(self, sample, k):
        """Half-open bins; what lies outside goes to the end bins."""
        return bisect_right(self.edges[k], sample, 1, self.B) - 1

    def table(self, l, m, k):
        """Log P_k(b) of all bins; Eq. 2, a normal distribution, or as given."""
        if self.counts:
            counts = [n + self.given["pseudocount"] for n in self.counts[l][m][k]]
            return [log(n / sum(counts)) if n else -inf for n in counts]
        if "mean" in self.given:
            inner = [(e - self.given["mean"][l][m][k]) / self.given["sd"][l][m][k] for e in self.edges[k][1:-1]]
            return [log_interval(low, high) for low, high in zip([-inf, *inner], [*inner, inf], strict=True)]
        return [log(p) if p else -inf for p in self.given["probabilities"][l][m][k]]

    def log_likelihood(self, tap):
        """Eq. 1."""
        bins = [(k, self.bin(value, k)) for sample in tap for k, value in enumerate(sample)]
        return [[self.power * fsum(cell[k][b] for k, b in bins) for cell in row] for row in self.log_p]

    def shift(self, belief, move):
        """Eq. 9."""
        border = self.given["border"]
        parts = [[[] for _ in range(self.M)] for _ in range(self.L)]
        lost, vacated = [[] for _ in range(self.M)], []
        for m, known in enumerate(self.trained):
            lands = [self.landing(known, l + move, border) for l in known]
            vacated.append([l for l in known if l not in lands])
            homeless = iter(vacated[m])
            if border == "circular":
                lands = [next(homeless) if place is None else place for place in lands]
            for l, place in zip(known, lands, strict=True):
                (lost[m] if place is None else parts[place][m]).append(belief[l][m])
        for m, free in enumerate(vacated):
            for l in free:
                if border == "uniform":
                    parts[l][m] = [log_sum([p for logs in lost for p in logs]) - log(sum(map(len, vacated)))]
                elif border == "uniform_what":
                    parts[l][m] = [log_sum(lost[m]) - log(len(free))]
                elif border == "prior":
                    parts[l][m] = [-log(sum(map(len, self.trained)))]
        return normalised([[log_sum(logs) for logs in row] for row in parts])[0]

    def landing(self, known, end, border):
        """Where belief comes to lie; none where it is lost."""
        if border == "clamp":
            end = min(max(end, 0), self.L - 1)
            return min(known, key=lambda l: (abs(l - end), l))
        end = end % self.L if border == "circular" else end
        return end if end in known else None

    def answer(self, line):
        """The answer to a tap; none where it is impossible."""
        likelihood = self.log_likelihood(line["samples"])
        before = self.shift(self.belief, line["move"]) if line["move"] else self.belief
        joint = [[p + q for p, q in zip(*rows, strict=True)] for rows in zip(before, likelihood, strict=True)]
        self.belief, evidence = normalised(joint)
        if evidence == -inf:
            return None
        posterior = [[exp(p) for p in row] for row in self.belief]
        where, what = [fsum(row) for row in posterior], [fsum(column) for column in zip(*posterior, strict=True)]
        m, l, theta_x = what.index(max(what)), where.index(max(where)), self.given["theta_x"]
        found = {
            "log_likelihood": likelihood,
            "log_evidence": evidence,
            "posterior": posterior,
            "log_posterior": self.belief,
            "where": where,
            "what": what,
            "decisions": [m if what[m] > theta and theta < 1 else None for theta in self.given["thresholds"]],
            "move": self.given["fixation"] - l if where[l] > theta_x and theta_x < 1 else 0,
        }
        if "strategy" in self.given:
            found["information"] = [self.information(self.shift(self.belief, i - l)) for i in range(self.L)]
            most = max(found["information"]) - 1e-12
            found["move"] = min(
                (i - l for i, x in enumerate(found["information"]) if x >= most), key=lambda d: (abs(d), d)
            )
        return found

    def information(self, belief):
        """Mutual information of the next tap and the object, the position or the class."""
        cells = {(l, m): exp(belief[l][m]) for l in range(self.L) for m in range(self.M) if self.pool[l][m]}
        total = fsum(cells.values())
        groups = {}
        for (l, m), p in cells.items():
            if p > 0:
                group = {"info-what": m, "info-where": l}.get(self.given["strategy"], (l, m))
                groups.setdefault(group, []).append([p / total * q for q in self.pool[l][m]])
        mixed = [[fsum(column) for column in zip(*rows, strict=True)] for rows in groups.values()]
        of_taps = entropy([fsum(column) for column in zip(*mixed, strict=True)])
        return of_taps - fsum(entropy(row) - entropy([fsum(row)]) for row in mixed)


def equal_bins(taps, bins):
    """Edges over the range of all training samples."""
    samples = [value for tap in taps for sample in tap for value in sample]
    low, high = min(samples), max(samples)
    return [low + (high - low) * b / bins for b in range(bins)] + [high]


def entropy(numbers):
    """Minus the sum of p log p, also of numbers that do not sum to one."""
    return -fsum(p * log(p) for p in numbers if p > 0)


def shares(logs):
    """Numbers of sum one from their logarithms; none where all are zero."""
    return [exp(x - log_sum(logs)) for x in logs] if max(logs, default=-inf) > -inf else []


def normalised(logs):
    """Beliefs of sum one, and the log of their sum."""
    total = log_sum([p for row in logs for p in row])
    return [[p - total if total > -inf else p for p in row] for row in logs], total


def written(value):
    """A value without infinities, which JSON has not."""
    return [written(part) for part in value] if isinstance(value, list) else None if value == -inf else value


def main():
    """Answers line by line."""
    case, name = None, ""
    for line in map(json.loads, filter(str.strip, sys.stdin)):
        found = {}
        if "format" in line:
            name, case = line["case"], Case(line)
            if "training" in line:
                found = {"tap": 0, "edges": case.range, "counts": case.counts}
        elif case is not None:
            found = {"tap": line["tap"]} | (case.answer(line) or {"error": "zero_evidence"})
        if found:
            sys.stdout.write(json.dumps({"case": name} | {key: written(value) for key, value in found.items()}) + "\n")
        case = None if "error" in found else case


main()
