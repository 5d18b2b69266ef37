"""Where the processor time of a process goes, from stacks of calls that `sampled` counts."""

import json
import re
import tempfile
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from operator import itemgetter
from pathlib import Path

from benchmarks.speed.commands.process import spent

SAMPLED = Path(__file__).parent / "sampled"
OTHER, EXIT = "other", "exit of Python"
_ANYWHERE = {
    "imports": r"<frozen importlib\._bootstrap>:_find_and_load$",
    "compiling": r"/jax/_src/(compiler|pjit|api|interpreters/\w+)\.py:|/numba/core/(dispatcher|caching|compiler)\.py:",
    "figures": r"/matplotlib/|/analysis/(\w+/)*figures?(_\w+)?\.py:",
}
"""Stages by calls that belong to them wherever they are in a stack; the first that fits counts."""
_OURS = re.compile(r"/(?P<module>(?:models|hardware|inference|analysis)/[\w/]+)\.py:")
_LEADING = re.compile(r"/(run|report|study|page|summary|results)$|^analysis/page/|^models/(threads|progress)$")
"""Modules that call the others in turn."""
_LEAST = 0.05

type Stack = tuple[str, ...]


def stacks(words: Sequence[str], folder: Path, inside: str = "") -> dict[Stack, float]:
    """Processor seconds of each stack of calls, outermost first, of a program and the Pythons that it starts.

    What Python takes to take itself down is the stack `(EXIT,)`.

    Args:
        words: Path of the program and its arguments.
        folder: Where it runs.
        inside: Only while the main thread is in this function, `file:name`; default: always.
    """
    counted: dict[Stack, float] = defaultdict(float)
    with tempfile.TemporaryDirectory() as written:
        variables = {"SOLIDTOUCH_STACKS": written, "SOLIDTOUCH_INSIDE": inside, "PYTHONPATH": str(SAMPLED)}
        used = spent(words, folder, variables).processor_s
        files = [json.loads(path.read_text(encoding="utf-8")) for path in Path(written).glob("*.json")]
    for *stack, seconds in (line for file in files for line in file["stacks"]):
        counted[tuple(stack)] += seconds
    if not inside:  # the process that was started has waited for the others, so its time is the largest
        counted[EXIT,] = used - max((file["processor_s"] for file in files), default=used)
    return dict(counted)


def stage(stack: Iterable[str]) -> str:
    """The stage of a stack: imports, compiling, figures, or else the module that the command's study calls.

    >>> stage(["/x/cli/audit.py:audit", "/x/analysis/audit/run.py:audit", "/x/inference/trials/tally.py:tally"])
    'trials/tally'
    """
    stack = list(stack)
    if stack == [EXIT]:
        return EXIT
    for name, pattern in _ANYWHERE.items():
        if any(re.search(pattern, call) for call in stack):
            return name
    modules = [found["module"] for call in stack if (found := _OURS.search(call))]
    called = next((module for module in modules if not _LEADING.search(module)), None)
    if called is not None:
        return "/".join(called.split("/")[-2:])
    return modules[-1] if modules else OTHER


def shares(counted: Mapping[Stack, float]) -> dict[str, float]:
    """Share of each stage in the processor time, the largest first; small ones together are `other`, at the end."""
    total = sum(counted.values()) or 1.0
    stages: dict[str, float] = defaultdict(float)
    for stack, seconds in counted.items():
        stages[stage(stack)] += seconds / total
    large = {name: share for name, share in _largest_first(stages) if share >= _LEAST and name != OTHER}
    rest = 1 - sum(large.values())
    return large | ({OTHER: rest} if rest >= _LEAST / 10 else {})


def functions(counted: Mapping[Stack, float], pattern: str = ".") -> dict[str, float]:
    """Processor seconds of each function whose `path:name` fits a pattern, with what it calls; the largest first."""
    found: dict[str, float] = defaultdict(float)
    for stack, seconds in counted.items():
        for call in {call for call in stack if re.search(pattern, call)}:
            found[call] += seconds
    return dict(_largest_first(found))


def _largest_first(seconds: Mapping[str, float]) -> list[tuple[str, float]]:
    return sorted(seconds.items(), key=itemgetter(1), reverse=True)
