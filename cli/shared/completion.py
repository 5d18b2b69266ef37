"""Values that the Tab key offers where an option takes names that are no fixed choice."""

from ...models.measurement.registry import NAMES


def model_names(incomplete: str) -> list[str]:
    """Names of measurement models, also behind `session:`; none where a file is being typed."""
    return _fitting([*NAMES, *(f"session:{name}" for name in NAMES if name != "session")], incomplete)


def model_names_or_all(incomplete: str) -> list[str]:
    """Likewise, and all of them."""
    return [*model_names(incomplete), *_fitting(["all"], incomplete)]


def model_lists(incomplete: str) -> list[str]:
    """Lists separated by commas, each with one name more."""
    before, comma, last = incomplete.rpartition(",")
    known = before.split(",")
    return [f"{before}{comma}{name}" for name in model_names(last) if name not in known]


def presets(incomplete: str) -> list[str]:
    """Presets of the simulated rig."""
    from ...hardware.simulator.settings import PRESETS

    return _fitting(list(PRESETS), incomplete)


def presets_or_model(incomplete: str) -> list[str]:
    """Likewise, and taps from a model."""
    return [*presets(incomplete), *_fitting(["model"], incomplete)]


def rigs(incomplete: str) -> list[str]:
    """Rigs that are no file."""
    return _fitting(["simulated", *(f"simulated:{name}" for name in presets("")), "replay:"], incomplete)


def strategies(incomplete: str) -> list[str]:
    """Control strategies, without those that hold a number."""
    from ...inference.names import MOVES

    return _fitting([form for form in MOVES if ":" not in form], incomplete)


def rules(incomplete: str) -> list[str]:
    """Stopping rules, up to their numbers."""
    from ...inference.names import STOPS

    return _fitting([form.partition(":")[0] + ":" for form in STOPS], incomplete)


def _fitting(words: list[str], incomplete: str) -> list[str]:
    return [word for word in words if word.startswith(incomplete)]
