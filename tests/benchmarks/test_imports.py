"""Every benchmark still finds what it imports, though most run by hand alone."""

from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
MODULES = sorted(
    path.relative_to(ROOT).with_suffix("").as_posix().replace("/", ".") for path in (ROOT / "benchmarks").rglob("*.py")
)


ELSEWHERE = {"benchmarks.site.build": "sphinx", "benchmarks.site.notebook": "jupytext"}
"""What needs packages of the group `docs`, which `make docs-check` installs and runs."""


@pytest.mark.parametrize("name", [name.removesuffix(".__init__") for name in MODULES])
def test_a_benchmark_can_be_imported(name):
    if name in ELSEWHERE:
        pytest.importorskip(ELSEWHERE[name], reason=f"{ELSEWHERE[name]} of the group docs is not installed")
    assert import_module(name).__doc__
