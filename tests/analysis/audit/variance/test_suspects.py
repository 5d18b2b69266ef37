"""Named suspects: found when they make evidence vary, not when they do not, whatever drifts."""

import numpy as np
import pytest
import xarray as xr
from scipy.stats import binom
from solidtouch.analysis.audit.variance.causes import split_variance
from solidtouch.analysis.audit.variance.classes import evidence_classes
from solidtouch.analysis.audit.variance.suspects import named_suspects, suspicion
from solidtouch.analysis.audit.verdict import first_cause
from solidtouch.analysis.stats.evidence import evidence
from solidtouch.models.errors import InputError
from solidtouch.models.measurement.histogram import fit
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.taps import TapSet, concatenate

L, M, J, K, N, R = 2, 3, 4, 3, 24, 3
"""Classes, samples, taxels, taps of each class and session, sessions."""


class NotLeaking:
    """What of a `Leakage` is read."""

    explained = ()
    sentences = ()


def made(seed=0, *, operator=0.0, temperature=0.0, drift=0.0, white=1.0):
    """Sessions whose classes come in turns, with two suspects, which add so much to all samples, and a drift."""
    rng = np.random.default_rng([seed, 2])
    level = 3 * np.arange(M)[:, None] + np.random.default_rng(3).normal(size=(L, 1, K))
    sets = []
    for r in range(R):
        _, what, where = (index.ravel() for index in np.indices((N, M, L)))
        n = len(what)
        who = rng.integers(3, size=n)
        warmth = rng.normal(size=n).cumsum()
        warmth = (warmth - warmth.mean()) / warmth.std()
        course = rng.normal(size=n).cumsum()
        course = (course - course.mean()) / course.std()
        shift = operator * (who - 1.0) + temperature * warmth + drift * course
        samples = level[where, what][:, None] + white * rng.normal(size=(n, J, K)) + shift[:, None, None]
        sets.append(
            TapSet.from_arrays(
                samples,
                what,
                [f"rod {m}" for m in range(M)],
                where=where,
                session=np.full(n, r),
                trial=np.arange(n),
                preprocessing=Preprocessing(samples=J),
                extra={"operator": np.array(["Ada", "Bo", "Cy"])[who], "temperature": warmth, "offset": samples[:, 0]},
            )
        )
    return sets


def split(sets, *names) -> xr.Dataset:
    grid, taps = sets[0].grid(), concatenate(sets)
    found = evidence(sets[0], taps, grid, fit(sets[0], grid, bins=30))
    return split_variance(taps, found, resamples=100, suspects=named_suspects(taps, names))


def p_values(sets, *names):
    """Of the tests alone."""
    grid, taps = sets[0].grid(), concatenate(sets)
    found = evidence(sets[0], taps, grid, fit(sets[0], grid, bins=30))
    suspects = [suspect.columns for suspect in named_suspects(taps, names)]
    classes, _ = evidence_classes(taps, found, suspects)
    totals = [found.values[one.members].sum(axis=(1, 2)) for one in classes]
    columns = [[one[found.tap][of.members] for of in classes] for one in suspects]
    return np.array([suspicion(one, classes, totals, 0, 199).p for one in columns])


def named(parts):
    return first_cause(NotLeaking(), parts, 1.0, 50.0, "right").name


def test_an_operator_that_makes_evidence_vary_is_named():
    """And not the temperature; shares still add up to one, and the others hardly change by looking."""
    sets = made(operator=1.0)
    found, blind = split(sets, "operator", "temperature"), split(sets)
    assert found.attrs["suspects"] == ["operator", "temperature"]
    assert found.attrs["suspect_p"][0] == 0.001
    assert found.attrs["suspect_p"][1] > 0.01
    assert named(found) == "covariate operator"
    assert float(found["share"].sum()) == pytest.approx(1)
    assert float(found["share"].sel(part="covariate operator")) > 0.2
    assert abs(float(found["share"].sel(part="covariate temperature"))) < 0.05
    assert float(found["share"].sel(part="session")) == pytest.approx(float(blind["share"].sel(part="session")))
    assert named(blind) == "common"


def test_a_suspect_that_walks_is_told_from_drift_by_what_it_does_from_tap_to_tap():
    """A temperature that makes evidence vary strongly is significant, the drift of something else is not."""
    found = split(made(temperature=4.0, white=0.3), "temperature")
    assert found.attrs["suspect_p"][0] <= 0.01
    assert split(made(drift=4.0, white=0.3), "temperature").attrs["suspect_p"][0] > 0.05


@pytest.mark.slow
@pytest.mark.parametrize("drift", [0.0, 3.0])
def test_a_suspect_without_effect_is_found_at_the_level_of_the_test(drift):
    """In 40 data sets; more than 7 at level .05 have a chance below one in a thousand."""
    hits = np.zeros(2)
    for seed in range(40):
        hits += p_values(made(seed, drift=drift), "operator", "temperature") <= 0.05
    assert (hits <= binom.isf(0.001, 40, 0.05)).all()


def test_p_is_never_zero():
    """The observed order counts as one of the permutations."""
    assert split(made(operator=9.0), "operator").attrs["suspect_p"] == [1 / 1000]


def test_what_is_the_same_in_a_session_cannot_be_tested():
    """Nor is it named, whatever sessions do."""
    sets = made()
    for r, taps in enumerate(sets):
        sets[r] = TapSet(taps.dataset.assign(operator=("tap", np.full(len(taps), f"operator {r}"))))
    found = split(sets, "operator")
    assert np.isnan(found.attrs["suspect_p"][0])
    assert float(found["share"].sel(part="covariate operator")) == pytest.approx(0.0, abs=1e-12)


def test_what_follows_the_order_is_said_to():
    """A clock follows it wholly, an operator drawn for each tap not at all."""
    sets = [TapSet(taps.dataset.assign(clock=("tap", taps.trial / 7.0))) for taps in made()]
    follows = split(sets, "clock", "operator").attrs["suspect_follows_order"]
    assert follows[0] > 0.95
    assert follows[1] < 0.2


def test_numbers_of_few_values_are_categories():
    taps = concatenate(made())
    few = TapSet(taps.dataset.assign(gripper=("tap", np.arange(len(taps)) % 3)))
    shapes = {one.name: one.columns.shape[1] for one in named_suspects(few, ["gripper", "operator", "temperature"])}
    assert shapes == {"gripper": 3, "operator": 3, "temperature": 2}
    assert [one.name for one in named_suspects(few, ["gripper", "gripper"])] == ["gripper"]


@pytest.mark.parametrize("name", ["speed", "offset", "taps", "session"])
def test_a_suspect_that_is_not_there_is_refused(name):
    """The sentence lists what could be named; arrays of taxels and labels cannot."""
    taps = concatenate(made())
    with pytest.raises(InputError, match=f"--covariate {name}: the taps have no .* there are: operator, temperature"):
        named_suspects(taps, ["operator", name])
    with pytest.raises(InputError, match="there is none"):
        named_suspects(TapSet(taps.dataset.drop_vars(["operator", "temperature"])), [name])


def test_suspects_survive_files(tmp_path):
    """Text and numbers come back from netCDF as they were, also where sessions are joined."""
    sets = made(operator=1.0)
    for r, taps in enumerate(sets):
        taps.save(tmp_path / f"{r}.nc")
    loaded = [TapSet.load(tmp_path / f"{r}.nc") for r in range(R)]
    xr.testing.assert_identical(split(loaded, "operator", "temperature"), split(sets, "operator", "temperature"))
