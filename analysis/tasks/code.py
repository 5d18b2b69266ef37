"""Source and versions that must be equal wherever cells of one study are computed."""

import hashlib
import platform
from functools import cache
from importlib.metadata import version
from pathlib import Path

PACKAGES = ("models", "hardware", "inference", "analysis")
LIBRARIES = ("numpy", "numba", "jax")


@cache
def code() -> dict[str, str]:
    """Versions of this software, of Python and of the libraries that compute, and a digest of the source."""
    libraries = {name: version(name) for name in LIBRARIES}
    return {
        "solidtouch": version("solidtouch"),
        "source": _source_digest(),
        "python": platform.python_version(),
        **libraries,
    }


def differences(expected: dict[str, str], found: dict[str, str]) -> list[str]:
    """Which parts differ, each as `numpy 2.4.0 instead of 2.5.0`."""
    return [
        f"{name} {found.get(name, 'none')} instead of {expected.get(name, 'none')}"
        for name in dict.fromkeys((*expected, *found))
        if expected.get(name) != found.get(name)
    ]


def _source_digest() -> str:
    digest = hashlib.sha256()
    root = Path(__file__).parents[2]
    for package in PACKAGES:
        for file in sorted((root / package).rglob("*.py")):
            digest.update(file.relative_to(root).as_posix().encode())
            digest.update(hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()[:12]
