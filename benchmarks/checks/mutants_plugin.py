"""Pytest plugin of `mutants`: the same hypothesis examples every time, and no shrinking after a failure."""

from hypothesis import Phase, settings


def pytest_collection() -> None:
    """Before tests are imported, after `conftest.py` has chosen its profile."""
    settings.register_profile(
        "mutants", deadline=None, derandomize=True, database=None, phases=(Phase.explicit, Phase.generate)
    )
    settings.load_profile("mutants")
