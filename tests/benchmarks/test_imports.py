"""Every benchmark still finds what it imports, though most run by hand alone."""

from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
MODULES = sorted(
    path.relative_to(ROOT).with_suffix("").as_posix().replace("/", ".") for path in (ROOT / "benchmarks").rglob("*.py")
)


@pytest.mark.parametrize("name", [name.removesuffix(".__init__") for name in MODULES])
def test_a_benchmark_can_be_imported(name):
    assert import_module(name).__doc__
