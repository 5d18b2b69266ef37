"""Models by name: what a file of a model holds, and what asking for one loads."""

from pathlib import Path

import pytest
from solidtouch.models.errors import InputError
from solidtouch.models.measurement.registry import KINDS, NAMES, measurement_model, row, split_name
from solidtouch.models.measurement.story import Story

ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "histogram"])
def test_a_story_goes_by_the_name_of_its_file(kind):
    """Parameters above 0 are parameters, and those of all classes alike are known by their dims."""
    story = measurement_model(kind)

    assert isinstance(story, Story)
    assert story.name == kind
    assert set(story.positive) <= set(story.dims)
    assert story.closed.__module__.endswith(kind.replace("-", "_"))


def test_every_model_says_what_it_relaxes():
    """In words of its own; in states it relaxes what `session` does."""
    rows = [row(name) for name in NAMES]

    assert len({found.how for found in rows}) == len(NAMES)
    assert rows[0].relaxes == "nothing"
    assert row("session:profile") == rows[-1] == row("session")


def test_unknown_names_are_refused():
    """The message lists those that there are."""
    for name in ("histo", "session:", "session:session", "session:histo", "", "sessions", "profile:session"):
        with pytest.raises(InputError, match=f"Unknown model '{name}'; choose from histogram, gaussian"):
            split_name(name)
    assert split_name("session") == ("histogram", True)
    assert split_name("session:profile") == ("profile", True)
    assert split_name("student") == ("student", False)


def test_a_model_is_known_to_its_file_and_the_registry():
    """No other file of the package asks for one by name, but studies that choose models and the default."""
    chosen = {"analysis/audit/leakage/run.py", "analysis/audit/remedies.py", "analysis/stats/checks.py"}
    for kind in KINDS[1:]:
        files = {"models/measurement/registry.py", f"models/measurement/{kind.replace('-', '_')}.py"}
        named = {
            path.relative_to(ROOT).as_posix()
            for package in ("models", "hardware", "inference", "analysis", "cli")
            for path in (ROOT / package).rglob("*.py")
            if f'"{kind}"' in path.read_text(encoding="utf-8")
        }
        assert named - chosen == files
