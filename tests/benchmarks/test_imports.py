"""Every benchmark still finds what it imports, though most run by hand alone."""

from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
MODULES = sorted(
    path.relative_to(ROOT).with_suffix("").as_posix().replace("/", ".") for path in (ROOT / "benchmarks").rglob("*.py")
)


ELSEWHERE = {
    "benchmarks.peers.pymdp_beliefs": "pymdp",
    "benchmarks.site.build": "sphinx",
    "benchmarks.site.notebook": "jupytext",
}
"""What needs pymdp, which runs in an environment of its own, or the extra `docs`, which `make docs-check` installs."""


@pytest.mark.parametrize("name", [name.removesuffix(".__init__") for name in MODULES])
def test_a_benchmark_can_be_imported(name):
    if name in ELSEWHERE:
        pytest.importorskip(ELSEWHERE[name], reason=f"{ELSEWHERE[name]} is not installed")
    assert import_module(name).__doc__
