"""Models by name: what a file of a model holds, and what asking for one loads."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from solidtouch.models import measurement
from solidtouch.models.errors import InputError
from solidtouch.models.io import model_file
from solidtouch.models.io.model_file import load_model
from solidtouch.models.measurement import registry
from solidtouch.models.measurement.draws import integrated
from solidtouch.models.measurement.generic import fit as generic_fit
from solidtouch.models.measurement.generic.story import GenericModel
from solidtouch.models.measurement.likelihood.story_likelihood import log_likelihoods
from solidtouch.models.measurement.registry import KINDS, NAMES, fit_model, measurement_model, row, split_name
from solidtouch.models.measurement.shared_gain import state_grid
from solidtouch.models.measurement.story import ParametricModel, Story
from solidtouch.models.settings import FitSettings

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
    """No other file of the package asks for one by name, but studies that choose models, the default and an example."""
    chosen = {"analysis/audit/leakage/run.py", "analysis/audit/remedies.py", "analysis/stats/checks.py"}
    chosen |= {"analysis/posteriors/front.py"}
    for kind in KINDS[1:]:
        files = {"models/measurement/registry.py", f"models/measurement/{kind.replace('-', '_')}.py"}
        named = {
            path.relative_to(ROOT).as_posix()
            for package in ("models", "hardware", "inference", "analysis", "cli")
            for path in (ROOT / package).rglob("*.py")
            if f'"{kind}"' in path.read_text(encoding="utf-8")
        }
        assert named - chosen == files


BARE = """\"\"\"A model that is its story alone.\"\"\"
from own_stories import laplace
from solidtouch.models.measurement.generic.contract import StoryFunction
from solidtouch.models.measurement.generic.story import GenericStory

MODEL = GenericStory(StoryFunction.of(laplace, "tenth-model"))
"""


@pytest.fixture(params=[pytest.param("fast", marks=pytest.mark.slow), "bare"])
def tenth(request, monkeypatch, tmp_path):
    """A further model: its file in the folder of models, and its name in the registry."""
    (tmp_path / "tenth_model.py").write_text(BARE)
    folder = Path(__file__).parent if request.param == "fast" else tmp_path
    for module in (registry, model_file):
        monkeypatch.setattr(module, "KINDS", (*KINDS, "tenth-model"))
    monkeypatch.setattr(measurement, "__path__", [*measurement.__path__, str(folder)])
    monkeypatch.setattr(generic_fit, "RUNS", 1)
    monkeypatch.setattr(generic_fit, "check_prior", lambda _: "")
    yield request.param
    sys.modules.pop(f"{measurement.__name__}.tenth_model", None)


def test_a_further_model_is_one_file_and_a_name(tenth, make_taps, tmp_path):
    """Fits, files, states, draws, predictions and the second likelihood follow; nothing else has to know it."""
    taps = make_taps(L=3, M=2, J=4, K=2)
    settings = FitSettings(bins=30, unconverged=True)
    fitted = fit_model("tenth-model", taps, taps.grid(), settings)
    plain, few, (where, what) = fitted.model, taps.taps[::9], taps.indices(taps.grid())
    states = state_grid(0.1, 0.2, 3, 1)
    session, file = replace(fitted.integrated(3, 0).model, states=states), tmp_path / "tenth.nc"
    session.save(file)

    assert isinstance(plain, ParametricModel if tenth == "fast" else GenericModel)
    found = load_model(file)
    assert found.name == "session:tenth-model"
    np.testing.assert_array_equal(found.log_likelihood(few), session.log_likelihood(few))
    for model in (plain, found):
        fast = model.log_likelihood(few) / model.exponent
        np.testing.assert_allclose(log_likelihoods(model, few), fast, rtol=1e-9, atol=1e-9)
    assert integrated(fitted, few, (where[::9], what[::9]), np.random.default_rng(0)).shape == (len(few),)
    classified = plain.log_likelihood(taps.taps)[np.arange(len(taps)), :, what].argmax(axis=1)
    assert (classified == where).mean() > 0.8
    assert "Laplace" in row("tenth-model").how
