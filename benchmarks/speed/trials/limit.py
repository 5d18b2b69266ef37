"""Trials in C, the limit of this machine, compiled for the numbers of positions and objects of a job."""

import ctypes
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.speed.c_code import compiled_c
from benchmarks.speed.trials.job import Decisions, Job
from benchmarks.speed.trials.vectorised import FLOOR_LIKELIHOOD


class _Job(ctypes.Structure):
    _fields_ = [
        *((name, ctypes.c_void_p) for name in ("likelihood", "prior", "tap", "number", "start", "held", "fixation")),
        ("thresholds", ctypes.c_void_p),
        *((name, ctypes.c_int32) for name in ("per_class", "deadline", "H", "active")),
    ]


class _Found(ctypes.Structure):
    _fields_ = [(name, ctypes.c_void_p) for name in ("taps", "what", "where")]


class Limit(NamedTuple):
    """A job laid out for C.

    Attributes:
        code: Compiled.
        vectors: Whether it holds a belief in AVX-512 registers; otherwise it has plain loops.
        arguments: The job as C sees it.
        arrays: What that points to.
        shape: (n, H).
    """

    code: ctypes.CDLL
    vectors: bool
    arguments: _Job
    arrays: dict[str, Any]
    shape: tuple[int, int]

    def play(self, threads: int = 1) -> Decisions:
        """Plays the trials in so many threads."""
        found = Decisions(*(np.empty(self.shape, dtype=np.int32) for _ in Decisions._fields))
        pointers = _Found(*(array.ctypes.data for array in found))
        cuts = np.linspace(0, self.shape[0], threads + 1).astype(int).tolist()

        def part(first: int, last: int) -> None:
            self.code.limit_trials(ctypes.byref(self.arguments), ctypes.byref(pointers), first, last)

        if threads == 1:
            part(*cuts)
        else:
            with ThreadPoolExecutor(threads) as pool:
                list(pool.map(part, cuts[:-1], cuts[1:]))
        return found


def limit(job: Job, plain: bool = False) -> Limit | None:
    """The job for C, or `None` without a compiler that takes it; what the compiler complains of is shown.

    Args:
        job: With at most 256 taps per class.
        plain: Plain loops even where the belief would fit into registers.
    """
    L, M = job.prior.shape
    code = compiled_c(Path(__file__).with_name("limit.c"), f"L={L}", f"M={M}", *(["PLAIN"] if plain else []))
    if code is None:
        return None
    code.limit_trials.argtypes = [ctypes.POINTER(_Job), ctypes.POINTER(_Found), ctypes.c_int64, ctypes.c_int64]
    code.limit_trials.restype = None
    arrays = {
        "likelihood": _laid_out(np.maximum(job.likelihood, FLOOR_LIKELIHOOD).transpose(0, 2, 1), np.float32),
        "prior": _laid_out(job.prior.T, np.float32),
        "tap": _laid_out(job.tap, np.int32),
        "number": _laid_out(job.number, np.uint8),
        "start": _laid_out(job.plan.where, np.int32),
        "held": _laid_out(job.plan.what, np.int32),
        "fixation": _laid_out(job.plan.fixation, np.int32),
        "thresholds": _laid_out(job.thresholds, np.float32),
    }
    pointers = [array.ctypes.data for array in arrays.values()]
    arguments = _Job(*pointers, job.tap.shape[2], job.deadline, len(job.thresholds), job.active)
    shape = len(job.number), len(job.thresholds)
    return Limit(code, bool(code.limit_vectors()), arguments, arrays, shape)


def _laid_out(array: Any, dtype: Any) -> Any:
    return np.ascontiguousarray(array, dtype=dtype)
