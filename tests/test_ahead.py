"""The study of two taps ahead runs on a few beliefs, and its page has a place for it."""

import importlib
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def study():
    """The module `benchmarks/ahead.py` with a small pool."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT / "benchmarks")
        module = importlib.import_module("ahead")
        patch.setattr(module, "POOL", 80)
        yield module


def test_more_draws_are_nearer_to_enumeration_and_errors_are_as_stated(study):
    found = study.judged(0, 4)
    few, some, many = (found[f"two taps, {draws} draws"] for draws in study.DRAWN)

    assert (found["one tap"].lost >= 0).all()
    assert all((one.lost >= 0).all() and (one.lost[one.same] == 0).all() for one in found.values())
    rough, fine, finest = (np.sqrt((one.error**2).mean()) for one in (few, some, many))
    assert finest < fine < rough
    assert np.sqrt((many.error**2).mean()) < 1.1 * np.sqrt((many.stated**2).mean())


def test_the_table_has_a_line_for_each_way_and_a_place(study):
    text = study.page(2, 2)

    assert "2 data sets of preset `paper`, 2 beliefs of each" in text
    assert text.count("\n|") == 2 + 1 + len(study.DRAWN) + 2
    study.check_block(ROOT / "docs" / "strategies.md", study.BLOCK)
