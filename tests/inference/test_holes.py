"""Grids on which some classes were never trained: belief stays in the trained ones, however it is computed."""

from dataclasses import replace
from itertools import product

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from slow_cases import slow_but
from solidtouch.hardware.replay import ReplayRig
from solidtouch.inference import reference
from solidtouch.inference.engines.compiled import FilterEngine
from solidtouch.inference.engines.engine import make_engine
from solidtouch.inference.engines.enumeration import enumerate_sequence
from solidtouch.inference.episode import perceive
from solidtouch.inference.information import shifted
from solidtouch.inference.moves.control import fixation
from solidtouch.inference.reference import BORDERS
from solidtouch.inference.trials import gpu as device
from solidtouch.inference.trials import lockstep
from solidtouch.inference.trials.records import plan_trials, tap_table, trial_uniforms
from solidtouch.inference.trials.run import run_trials
from solidtouch.models.measurement.states import States
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.settings import PlaySettings
from solidtouch.models.taps import TapSet
from solidtouch.models.touch import KERNEL_BORDERS

L, M = 6, 3
PATTERNS = {
    "full": (),
    "checkerboard": [(l, m) for l, m in product(range(L), range(M)) if (l + m) % 2],
    "half of one object": [(1, 1), (3, 1), (4, 1)],
    "one missing": [(2, 0)],
    "one position of one object": [(l, 2) for l in range(L) if l != 4],
}
MOVES = (0, 1, -1, 2, -3, 5, -5, 7, -13)


def known(pattern):
    trained = np.ones((L, M), dtype=bool)
    for cell in PATTERNS[pattern]:
        trained[cell] = False
    return trained


def landed(trained, delta, border):
    """Eq. 9 as a matrix over classes l M + m, written down class by class; without the normalisation of `prior`."""
    matrix = np.zeros((L * M, L * M))
    cells = [(l, m) for l in range(L) for m in range(M) if trained[l, m]]
    target = {}
    for l, m in cells:
        places = [p for p in range(L) if trained[p, m]]
        to = l + delta
        if border == "circular":
            to %= L
        if border == "clamp":
            to = sorted((abs(p - min(max(to, 0), L - 1)), p) for p in places)[0][1]
        target[l, m] = (to, m) if to in places else None
    vacated = [cell for cell in cells if cell not in target.values()]
    if border == "circular":
        for m in range(M):
            lost = [cell for cell in cells if cell[1] == m and target[cell] is None]
            target |= dict(zip(lost, [cell for cell in vacated if cell[1] == m], strict=True))
    for (l, m), to in target.items():
        shared = [cell for cell in vacated if border == "uniform" or cell[1] == m]
        for p, w in [to] if to else shared if border != "prior" else ():
            matrix[p * M + w, l * M + m] = 1 if to else 1 / len(shared)
    return matrix, [p * M + w for p, w in vacated]


@pytest.mark.parametrize("border", BORDERS)
@pytest.mark.parametrize("pattern", PATTERNS)
def test_the_reference_moves_belief_as_the_rule_says(rng, pattern, border):
    trained = known(pattern)
    belief = np.where(trained, rng.dirichlet(np.ones(L * M)).reshape(L, M), 0.0)
    belief /= belief.sum()
    for delta in MOVES:
        matrix, vacated = landed(trained, delta, border)
        expected = matrix @ belief.ravel()
        if border == "prior":
            expected[vacated] = 1 / trained.sum()
        expected = (expected / expected.sum()).reshape(L, M)
        with np.errstate(divide="ignore"):
            logs = reference.shift_log(np.log(belief), delta, border, trained)

        np.testing.assert_allclose(reference.shift(belief, delta, border, trained), expected, rtol=0, atol=1e-15)
        np.testing.assert_allclose(np.exp(logs), expected, rtol=0, atol=1e-14)
        if border not in ("uniform", "prior"):
            np.testing.assert_allclose(expected.sum(axis=0), belief.sum(axis=0), rtol=1e-12)


def test_the_rule_by_hand():
    """Object 0 was trained at 0, 2 and 3, object 1 at 1 only."""
    trained = np.array([[1, 0], [0, 1], [1, 0], [1, 0]], dtype=bool)
    belief = np.array([[0.1, 0.0], [0.0, 0.4], [0.2, 0.0], [0.3, 0.0]])
    moved = {border: reference.shift(belief, 1, border, trained).T for border in BORDERS}

    # Position 0 would land on 1 and 3 beyond the end, so 0.1 + 0.3 are lost, 0 and 2 vacated; object 1 loses its one.
    assert moved["uniform"] == pytest.approx(np.array([[0.8 / 3, 0, 0.8 / 3, 0.2], [0, 0.8 / 3, 0, 0]]))
    assert moved["uniform_what"] == pytest.approx(np.array([[0.2, 0, 0.2, 0.2], [0, 0.4, 0, 0]]))
    assert moved["prior"] == pytest.approx(
        np.array([[0.25 / 0.95, 0, 0.25 / 0.95, 0.2 / 0.95], [0, 0.25 / 0.95, 0, 0]])
    )
    assert moved["clamp"] == pytest.approx(np.array([[0.1, 0, 0, 0.5], [0, 0.4, 0, 0]]))
    assert moved["circular"] == pytest.approx(np.array([[0.3, 0, 0.1, 0.2], [0, 0.4, 0, 0]]))


def test_belief_in_an_untrained_class_is_an_error_of_the_caller():
    with pytest.raises(ValueError, match="outside the trained classes"):
        reference.shift(np.full((2, 1), 0.5), 1, "uniform", np.array([[True], [False]]))


@settings(max_examples=60)
@given(
    sizes=st.sampled_from([(6, 3), (5, 1)]),
    share=st.sampled_from([0.3, 0.6, 0.9, 1.0]),
    depth=st.sampled_from([1.0, 400.0]),
    seed=st.integers(0, 2**32 - 1),
)
def test_every_way_of_shifting_is_the_reference(sizes, share, depth, seed):
    """Also by moves beyond the range, and where beliefs are far below what a floating-point number holds."""
    rng = np.random.default_rng(seed)
    trained = rng.random(sizes) < share
    trained[rng.integers(sizes[0]), rng.integers(sizes[1])] = True
    logs = np.where(trained, depth * rng.normal(size=sizes), -np.inf)
    logs -= np.logaddexp.reduce(logs.ravel())
    delta = int(rng.integers(-9, 10)) or 1
    for number, border in enumerate(BORDERS):
        expected = reference.shift_log(logs, delta, border, trained)
        with np.errstate(divide="ignore", invalid="ignore"), jax.enable_x64(True):
            found = {
                "lockstep": lockstep.shift_beliefs(logs[np.newaxis], np.array([delta]), border, trained)[0],
                "device": np.asarray(_on_device(logs, delta, number, trained)),
                "information": np.log(shifted(np.exp(logs), [delta], border, trained)[0]),
                "filter": _compiled(logs, delta, border, trained),
            }
        for name, after in found.items():
            seen = expected > (-600 if name == "information" else -np.inf)
            assert (np.exp(after[~trained]) == 0).all(), name
            np.testing.assert_allclose(after[seen], expected[seen], rtol=1e-11, atol=1e-9, err_msg=f"{name} {border}")


_SHIFT = jax.jit(device.shift, static_argnums=(2, 3))


def _on_device(logs, delta, number, trained):
    return _SHIFT(jax.numpy.asarray(logs), delta, number, 1, jax.numpy.asarray(trained))


def _compiled(logs, delta, border, trained):
    class Model:
        log_prior = logs
        grid = type("Grid", (), {"M": logs.shape[1]})

    Model.trained = trained
    return FilterEngine(Model, border).shift(logs, delta)


@pytest.mark.parametrize("border", BORDERS)
def test_full_grids_are_bit_for_bit_as_without_a_mask(rng, make_model, border):
    """The path without holes, everywhere."""
    trained, number = known("full"), BORDERS.index(border)
    belief = rng.dirichlet(np.ones(L * M)).reshape(L, M)
    logs, some = np.log(belief), np.array([2])
    for delta in MOVES:
        same = [
            [reference.shift(belief, delta, border, mask) for mask in (None, trained)],
            [reference.shift_log(logs, delta, border, mask) for mask in (None, trained)],
            [shifted(belief, [delta], border, mask) for mask in (None, trained)],
            [lockstep.shift_beliefs(logs[np.newaxis], some, border, mask) for mask in (None, trained)],
            [
                make_engine("numpy", make_model(L, M), border).shift(logs, delta),
                reference.shift_log(logs, delta, border),
            ],
        ]
        for one, other in same:
            assert np.array_equal(one, other)
        with jax.enable_x64(True):  # the general rule for arrays gives the same but for rounding
            around = _on_device(logs, delta, number, trained)
            np.testing.assert_allclose(around, _SHIFT(jax.numpy.asarray(logs), delta, number, 1), rtol=1e-12)


@pytest.mark.parametrize("border", KERNEL_BORDERS)
@pytest.mark.parametrize("pattern", slow_but(["checkerboard"], [pattern for pattern in PATTERNS if pattern != "full"]))
def test_engines_agree_with_the_sum_over_all_paths(make_model, draw_samples, pattern, border):
    """Of classes, by brute force: the likelihoods of all taps and the transitions written down above."""
    model = make_model(L, M, 2, 3, 5, seed=3, taps=9, untrained=PATTERNS[pattern])
    taps, deltas = draw_samples(model, 3, seed=1), [2, -3]
    likelihood = np.exp(model.log_likelihood(taps)).reshape(len(taps), -1)
    joint = np.exp(model.log_prior).ravel() * likelihood[0]
    filtered = [joint / joint.sum()]
    for delta, here in zip(deltas, likelihood[1:], strict=True):
        joint = landed(model.trained, delta, border)[0] @ joint * here
        filtered.append(joint / joint.sum())
    expected = np.array(filtered).reshape(-1, L, M)
    whole = enumerate_sequence(model, taps, deltas, border)

    np.testing.assert_allclose(whole.filtered, expected, rtol=0, atol=1e-12)
    assert whole.log_evidence[-1] == pytest.approx(np.log(joint.sum()), abs=1e-10)
    for name in ("numpy", "numpyro", "filter"):
        engine, log_belief, found = make_engine(name, model, border), model.log_prior, []
        for tap, delta in zip(taps, [0, *deltas], strict=True):
            log_belief, _ = engine.update(engine.shift(log_belief, delta), tap)
            found.append(np.exp(log_belief))
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12, err_msg=name)


@pytest.mark.parametrize("border", [border for border in BORDERS if border != "prior"])
def test_states_keep_their_belief(rng, make_model, border):
    """Of every engine; `uniform` redraws the object within each state."""
    states = States(np.array([0.9, 1.1]), np.array([0.0, 0.2]), np.log([[0.5], [0.5]]) * np.ones((2, M)))
    model = replace(make_model(L, M, untrained=PATTERNS["checkerboard"]), states=states)
    log_belief = model.log_prior + rng.normal(size=model.log_prior.shape)
    log_belief -= np.logaddexp.reduce(log_belief.ravel())
    names = ("numpy", "numpyro", "filter")
    for delta in MOVES:
        moved = {name: np.exp(make_engine(name, model, border).shift(log_belief, delta)) for name in names}
        moved["lockstep"] = np.exp(
            lockstep.shifted(log_belief[np.newaxis], np.array([delta]), border, M, model.trained)[0]
        )
        for after in moved.values():
            np.testing.assert_allclose(after, moved["numpy"], rtol=0, atol=1e-14)
            by_state = after.reshape(L, 2, M).sum(axis=(0, 2))
            np.testing.assert_allclose(by_state, np.exp(log_belief).reshape(L, 2, M).sum(axis=(0, 2)), atol=1e-12)


@pytest.fixture(scope="module")
def recorded(make_model, draw_samples):
    """A model with holes by pattern, and five test taps of every trained class."""

    def make(pattern, pseudocount=0.01):
        model = make_model(L, M, 2, 4, 6, seed=5, taps=4, pseudocount=pseudocount, untrained=PATTERNS[pattern])
        cells = np.repeat(np.argwhere(model.trained), 5, axis=0)
        full = make_model(L, M, 2, 4, 6, seed=5, taps=4)
        taps = np.concatenate([draw_samples(full, 1, i, l, m) for i, (l, m) in enumerate(cells)])
        taps[::6] = np.random.default_rng(1).uniform(-1.5, 2.0, size=taps[::6].shape)  # some fall into empty bins
        grid = model.grid
        return model, TapSet.from_arrays(
            taps,
            cells[:, 1],
            grid.what_name,
            preprocessing=Preprocessing(samples=4),
            where=grid.where_value[cells[:, 0]],
            where_value=grid.where_value,
            where_unit="mm",
        )

    return make


@pytest.mark.parametrize(
    ("pattern", "pseudocount"),
    slow_but(
        [("checkerboard", 0.01), ("half of one object", 0.0), ("one missing", 0.01)],
        list(product(["checkerboard", "half of one object", "one missing"], [0.01, 0.0])),
    ),
)
def test_trials_are_episodes_on_grids_with_holes(recorded, pattern, pseudocount):
    """Compiled, in step, as arrays and tap by tap; without a pseudocount some end with no class left.

    Arrays are compiled for every border, so one does: the moves of all of them are compared above.
    """
    model, taps = recorded(pattern, pseudocount)
    table, thetas, deadline = tap_table(model, taps), (0.5, 0.9, 1.0), 12
    plan = plan_trials(table.pool, 25, 0, fixation=4)
    for border in BORDERS:
        how = {"play": PlaySettings(theta_x=0.0, border=border, deadline=deadline)}
        trials = run_trials(table, plan, thetas, **how)
        if pattern == "half of one object" and not pseudocount and border == "clamp":
            arrays = run_trials(table, plan, thetas, **how, device="xla-cpu")
            for name in trials._fields:
                np.testing.assert_allclose(getattr(arrays, name), getattr(trials, name), atol=1e-10, err_msg=name)
        assert trials.no_class_left.any() == (pseudocount == 0)
        record = lockstep.play(table, plan, fixation(4), border=border, deadline=deadline)
        assert record.no_class_left.tolist() == trials.no_class_left[:, -1].tolist()
        engine = make_engine("numpy", model, border)
        for i, (where, what, point, stream, _) in enumerate(zip(*plan, strict=True)):
            uniforms = trial_uniforms(0, stream, deadline).tolist()
            for h, theta in enumerate(thetas):
                rig = ReplayRig(taps, model.grid, where, what, iter(uniforms))
                episode = perceive(rig, engine, theta, fixation(point), deadline)
                expected = (episode.taps, episode.what, episode.where, episode.stopped, episode.no_class_left)
                fields = trials.taps, trials.what, trials.where, trials.stopped, trials.no_class_left
                assert expected == tuple(field[i, h] for field in fields)
                assert trials.belief[i, h] == pytest.approx(np.exp(episode.log_beliefs[-1]).sum(axis=0).max(), abs=1e-9)


def test_moves_around_holes_can_be_undone_where_nothing_is_lost():
    """A checkerboard moved by two and back under `circular` is the same again."""
    trained = known("checkerboard")
    belief = np.where(trained, np.arange(1.0, 1 + L * M).reshape(L, M), 0.0)
    belief /= belief.sum()
    moved = reference.shift(reference.shift(belief, 2, "circular", trained), -2, "circular", trained)

    np.testing.assert_allclose(moved, belief, rtol=1e-14)
