"""Peak memory of a process that plays many trials: `python -m benchmarks.speed.memory TRIALS` prints it in MiB."""

import re
import resource
import subprocess
import sys
from pathlib import Path

from solidtouch.inference.episode import DEADLINE
from solidtouch.inference.trials.tally import tally_trials
from solidtouch.models.settings import PlaySettings

from benchmarks.speed.trials.job import POLICIES, SEED, paper_table

THRESHOLD = 0.995


def peaks(quick: bool = False) -> dict[int, float]:
    """Peak resident memory in MiB of a process of its own, by the number of passive trials that it plays."""
    return {trials: _peak(trials) for trials in ((100,) if quick else (10**5, 10**7))}


def stream(trials: int, policy: str) -> int:
    """Plays and counts trials of the paper's job on one core; returns the number of useful taps."""
    table = paper_table()
    options = {
        "fixation": (len(table.log_prior) - 1) // 2,
        "play": PlaySettings(theta_x=POLICIES[policy], deadline=DEADLINE),
        "seed": SEED,
        "workers": 1,
    }
    tally = tally_trials(table, THRESHOLD, trials, **options)
    return int(tally.taps[0] @ range(tally.taps.shape[1]))


def _peak(trials: int) -> float:
    words = [sys.executable, "-m", "benchmarks.speed.memory", str(trials)]
    return float(subprocess.run(words, capture_output=True, text=True, check=True).stdout)  # noqa: S603


def _own_peak() -> float:
    """Of this process in MiB."""
    status = Path("/proc/self/status")
    if status.is_file():  # on Linux the other way may tell the peak of the process that started this one
        return int(re.search(r"VmHWM:\s+(\d+) kB", status.read_text(encoding="utf-8"))[1]) / 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1024**2 if sys.platform == "darwin" else 1024)


if __name__ == "__main__":
    stream(int(sys.argv[1]), "passive")
    print(_own_peak())
