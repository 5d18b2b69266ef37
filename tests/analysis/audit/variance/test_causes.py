"""Variances that taps were made with are found, and each cause is named when it is the one that was made."""

import numpy as np
import pytest
import xarray as xr
from solidtouch.analysis.audit.variance import causes
from solidtouch.analysis.audit.variance.causes import CAUSES, SIZES, first_cause, split_variance
from solidtouch.analysis.audit.variance.sample_covariance import SampleMoments
from solidtouch.analysis.audit.variance.split import EvidenceMoments, session_p
from solidtouch.analysis.stats.evidence import evidence
from solidtouch.models.measurement.histogram import fit
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.taps import TapSet, concatenate

L, M, J, K, N, R = 2, 3, 16, 5, 36, 3
"""Classes, samples, taxels, taps of each class and session, sessions."""
GAIN, TIMING, COMMON, LASTING, WHITE = 0.08, 0.4, 1.2, 0.9, 1.0


def lasting(rng, shape, *, correlation=0.9):
    """Noise of variance 1 along the second axis, shape (N, J, ...)."""
    noise = rng.normal(size=shape)
    for j in range(1, shape[1]):
        noise[:, j] = correlation * noise[:, j - 1] + np.sqrt(1 - correlation**2) * noise[:, j]
    return noise


def made(
    seed=0,
    *,
    sizes=(L, M, J, K, N, R),
    gain=0.0,
    timing=0.0,
    common=0.0,
    lasts=0.0,
    white=WHITE,
    session=0.0,
    place=0.0,
    order=0.0,
    step=1.0,
) -> list[TapSet]:
    """Sessions of taps whose class means are bumps of unlike height, with these standard deviations added.

    `session` adds to all samples of an object in a session, `order` falls along its taps from plus to minus.
    """
    L, M, J, K, N, R = sizes
    rng = np.random.default_rng([seed, 1])
    height = 10 + 3 * np.random.default_rng(3).normal(size=(L, 1, K)) + step * np.arange(M)[:, None]
    sets = []
    for r in range(R):
        what, where, number = (index.ravel() for index in np.indices((M, L, N)))
        n = len(what)
        inside = (number + 0.5) / N - 0.5
        when = np.arange(J) - (J - 1) / 2 - timing * rng.normal(size=(n, 1))
        bump = np.exp(-(when**2) / (2 * (J / 6) ** 2))
        samples = height[where, what][:, None, :] * bump[:, :, None] * (1 + gain * rng.normal(size=(n, 1, 1)))
        samples += (
            common * lasting(rng, (n, J, 1)) + lasts * lasting(rng, (n, J, K)) + white * rng.normal(size=(n, J, K))
        )
        samples += session * rng.normal(size=(L, M))[where, what][:, None, None]
        samples += (np.sqrt(12) * (place + order) * inside)[:, None, None]
        sets.append(
            TapSet.from_arrays(
                samples,
                what,
                [f"rod {2 + 2 * m} mm" for m in range(M)],
                where=where + (0.9 * inside if place else 0.0),
                where_value=np.arange(L),
                where_edges=np.arange(L + 1) - 0.5,
                where_unit="mm",
                session=np.full(n, r),
                trial=number,
                preprocessing=Preprocessing(samples=J),
            )
        )
    return sets


def judged(sets, *, pseudocount=0.01):
    """All taps and their evidence, where the first session trains."""
    grid = sets[0].grid()
    taps = concatenate(sets)
    return taps, evidence(sets[0], taps, grid, fit(sets[0], grid, bins=30, pseudocount=pseudocount))


def split(sets, **more) -> xr.Dataset:
    return split_variance(*judged(sets), **more)


SIZE = {
    "gain": ({"gain": GAIN}, "gain_sd", GAIN),
    "timing": ({"timing": TIMING}, "timing_sd", TIMING),
    "common": ({"common": COMMON}, "common_sd", COMMON),
    "noise": ({"lasts": LASTING}, "noise_sd", np.hypot(LASTING, WHITE)),
    "what lasts": ({"lasts": LASTING}, "lasting_sd", LASTING * np.sqrt(0.9)),
}


@pytest.mark.parametrize(("settings", "name", "truth"), SIZE.values(), ids=SIZE)
def test_sizes_are_those_that_were_made(settings, name, truth):
    """Each standard deviation comes out within 12%."""
    found = split(made(**settings), resamples=20)
    assert float(found[name]) == pytest.approx(truth, rel=0.12)


def test_several_causes_at_once_are_told_apart():
    """All four standard deviations come out within 25% when all act together."""
    found = split(made(gain=GAIN, timing=TIMING, common=COMMON, lasts=LASTING), resamples=20)
    truths = {"gain_sd": GAIN, "timing_sd": TIMING, "common_sd": COMMON, "noise_sd": np.hypot(LASTING, WHITE)}
    for name, truth in truths.items():
        assert float(found[name]) == pytest.approx(truth, rel=0.25), name


NAMED = {
    "gain": {"gain": 2 * GAIN},
    "common": {"common": COMMON},
    "noise": {"lasts": 1.5, "white": 0.5},
    "session": {"session": 0.5},
    "place": {"place": 1.0},
    "order": {"order": 1.0},
}


@pytest.mark.parametrize(("cause", "settings"), NAMED.items(), ids=NAMED)
def test_what_was_made_is_named(cause, settings):
    """The cause that acts alone has the largest share of all, but for independent samples; nothing else comes near."""
    found = split(made(**settings), resamples=100)
    share = found["share"].sel(part=list(CAUSES))
    assert first_cause(found) == cause
    assert float(share.max() / np.sort(share)[-2]) > 2
    assert first_cause(found, without=(cause,)) != cause
    assert first_cause(found, least_share=1.5) is None


def test_nothing_is_named_where_samples_are_independent():
    """White noise has a sequence effect near one, and the test of sessions sees nothing."""
    taps, found = judged(made(seed=1))
    parts = split_variance(taps, found)
    assert first_cause(parts) is None
    assert float(parts["sequence_effect"]) == pytest.approx(1, abs=0.5)
    assert float(parts["design_effect"]) == pytest.approx(1, abs=0.2)
    assert session_p(taps, found, 99) > 0.05


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("sizes", [(2, 3, 6, 5, 8, 3), (3, 1, 1, 4, 7, 2), (1, 2, 5, 1, 9, 4)])
def test_shares_add_up_to_one(sizes, seed):
    """Whatever the sizes and however little there is; the ratios add up to the effect of a sequence."""
    found = split(made(seed, sizes=sizes, common=0.5), resamples=30)
    assert float(found["share"].sum()) == pytest.approx(1)
    assert float(found["ratio"].sum()) == pytest.approx(float(found["sequence_effect"]))
    assert float(found["sequence_effect"]) > 0
    assert (abs(found["share"]) < 1e3).all()
    assert float(found["share"].sel(part="independent")) == pytest.approx(1 / float(found["sequence_effect"]))


def test_sessions_cannot_share_less_than_nothing_of_a_sequence():
    """Sessions that are more alike than chance leave a positive variance, so shares stay finite and add up.

    Taps of a class come in pairs with opposite noise, far apart in their session.
    """
    sets = made(sizes=(1, 2, 3, 2, 40, 2), step=3.0)
    level = np.mean([taps.taps.reshape(2, 40, 3, 2) for taps in sets], axis=(0, 2))[:, None]
    for number, taps in enumerate(sets):
        samples = taps.taps.reshape(2, 40, 3, 2).copy()
        samples[:, 20:] = 2 * level - samples[:, :20]
        sets[number] = TapSet(taps.dataset.assign(taps=(("tap", "sample", "taxel"), samples.reshape(-1, 3, 2))))
    found = split(sets, n=50, resamples=30)
    assert float(found["share"].sel(part="session")) < 0
    assert float(found["share"].sum()) == pytest.approx(1)
    assert float(found["sequence_effect"]) > 0
    assert np.isfinite(found["share"]).all()


def test_the_order_of_a_file_does_not_matter(rng):
    """Taps that stand elsewhere in their file, with their trial numbers, give the same parts."""
    sets = made(sizes=(2, 3, 6, 5, 12, 3), order=0.7, session=0.4)
    shuffled = [taps.select(rng.permutation(len(taps))) for taps in sets]
    xr.testing.assert_allclose(split(sets, resamples=30), split(shuffled, resamples=30))


def test_names_of_classes_and_taxels_do_not_matter(rng):
    """Objects and taxels in another order change no estimate."""
    sets = made(sizes=(2, 3, 6, 5, 12, 3), common=0.7)
    objects, taxels = rng.permutation(3), rng.permutation(5)

    def renamed(taps):
        data = taps.dataset.isel(taxel=taxels).assign_coords(what=("tap", np.argsort(objects)[taps.what]))
        return TapSet(data.assign_coords(what_name=("what_class", [taps.what_name[m] for m in objects])))

    one, other = split(sets, resamples=30), split([renamed(taps) for taps in sets], resamples=30)
    for name in ("share", "ratio", *SIZES):
        np.testing.assert_allclose(one[name], other[name], atol=1e-9)


def test_unit_and_level_of_samples_do_not_matter():
    """Twice the counts on another idle level have the same shares, and noise twice as large."""
    sets = made(sizes=(2, 3, 6, 5, 12, 3), common=0.7, gain=0.05)
    larger = [TapSet(taps.dataset.assign(taps=2 * taps.dataset["taps"])) for taps in sets]
    one, other = split(sets, resamples=30), split(larger, resamples=30)
    np.testing.assert_allclose(other["share"], one["share"], atol=1e-6)
    assert float(other["common_sd"]) == pytest.approx(2 * float(one["common_sd"]))
    assert float(other["gain_sd"]) == pytest.approx(float(one["gain_sd"]))


def test_dead_taxels_add_nothing():
    """A taxel that never changes leaves every number as it is."""
    sets = made(sizes=(2, 3, 6, 5, 12, 3), common=0.7)

    def with_dead(taps):
        samples = np.concatenate([taps.taps, np.full((*taps.taps.shape[:2], 1), 3.0)], axis=2)
        return TapSet(taps.dataset.drop_vars("taps").assign(taps=(("tap", "sample", "taxel"), samples)))

    one, other = split(sets, resamples=30), split([with_dead(taps) for taps in sets], resamples=30)
    np.testing.assert_allclose(other["share"], one["share"], atol=1e-9)
    assert float(other["common_sd"]) == pytest.approx(float(one["common_sd"]))


def test_classes_whose_evidence_does_not_vary_are_left_out():
    """Constant taps of one object leave the parts to the other classes, those of all leave none."""
    sets = made(sizes=(2, 3, 6, 5, 12, 3), common=0.7)

    def constant(taps, objects):
        samples = np.where(np.isin(taps.what, objects)[:, None, None], 40.0, taps.taps)
        return TapSet(taps.dataset.assign(taps=(("tap", "sample", "taxel"), samples)))

    some = split([constant(taps, [2]) for taps in sets], resamples=30)
    assert some.attrs["classes"] == 4
    assert float(some["share"].sel(part="independent")) > 0.1
    assert float(some["share"].sel(part="common")) > 0.01
    none = split([constant(taps, [0, 1, 2]) for taps in sets], resamples=30)
    assert none.attrs["classes"] == 0
    assert np.isnan(none["share"]).all()
    assert first_cause(none) is None


def test_few_classes_name_nothing_but_sessions():
    """Resampling two classes leaves their smaller share, which is above zero by chance once in four."""
    found = split(made(sizes=(1, 2, 6, 5, 20, 3), order=0.7, session=0.4))
    assert float(found["share_sure"].sel(part="order")) > 0
    assert first_cause(found, without=("session",)) is None
    assert first_cause(found.assign_attrs(classes=4), without=("session",)) == "order"
    assert first_cause(found) == "session"


def test_few_taps_of_a_class_give_nothing():
    """Two taps of each class and session leave no freedom; the test of sessions says nothing either."""
    taps, found = judged(made(sizes=(2, 3, 6, 5, 2, 3)))
    parts = split_variance(taps, found, resamples=30)
    assert parts.attrs["classes"] == 0
    assert np.isnan(parts["sequence_effect"])
    assert np.isnan(session_p(taps, found, 99))


def test_one_session_says_nothing_of_sessions():
    """Its share is zero and the test has nothing to exchange."""
    taps, found = judged(made(sizes=(2, 3, 6, 5, 12, 1), common=0.7))
    parts = split_variance(taps, found, resamples=30)
    assert float(parts["share"].sel(part="session")) == 0
    assert np.isnan(session_p(taps, found, 99))


@pytest.mark.slow
def test_p_values_of_sessions_are_uniform_where_sessions_are_alike():
    """Of 60 data sets of exchangeable sessions few reject; p-values are spread over the whole range.

    The chance of more than 9 of 60 at level .05 is below one in a thousand.
    """
    p = [session_p(*judged(made(seed, sizes=(1, 2, 3, 2, 16, 3), step=2.0)), 49, seed) for seed in range(60)]
    assert sum(value <= 0.05 for value in p) <= 9
    assert 0.4 < np.mean(p) < 0.85
    assert min(p) < 0.3
    assert max(p) > 0.7


def test_an_order_that_matters_has_the_smallest_p_value():
    """One over the permutations and one, as the observed order is one of them; never zero."""
    sets = made(sizes=(2, 3, 6, 5, 16, 3), order=3.0)
    assert split(sets, resamples=20).attrs["covariate_p"] == pytest.approx(1 / 1000)


def test_sessions_that_differ_have_the_smallest_p_value():
    """It is two over the permutations and one, for two halves."""
    assert session_p(*judged(made(session=0.7)), 199) == pytest.approx(2 / 200)


def test_results_repeat_with_the_seed():
    """And only intervals change with another one."""
    sets = made(sizes=(2, 3, 6, 5, 12, 3), session=0.3)
    one, again, other = split(sets, seed=4), split(sets, seed=4), split(sets, seed=5)
    xr.testing.assert_identical(one, again)
    np.testing.assert_array_equal(one["share"], other["share"])
    assert not np.array_equal(one["share_low"], other["share_low"])


def test_responses_are_corrected_threefold_at_most():
    """Of one class: a gain of variance 1 predicts 1 of the 10 that is to be explained, so 7 remain."""
    ones, none = np.ones(1), np.zeros(1)
    known = SampleMoments(np.eye(4)[None], np.array([[1.0, 0, 0, 0]]), none[None], ones[None], np.zeros((1, 4, 1)))
    values = EvidenceMoments(
        session=none,
        serial=none,
        covariates=none,
        suspects=np.zeros((1, 0)),
        whole=11 * ones,
        independent=ones,
        excess=10 * ones,
        spread=ones,
        patterns=np.array([[1.0, 0, 0, 0]]),
        noise=none[None],
    )
    found = causes._combine(known, values, np.ones((2, 1)), 5, "", [])
    np.testing.assert_allclose(found["share gain"], 3 / 11)
    np.testing.assert_allclose(found["share rest"], 7 / 11)
