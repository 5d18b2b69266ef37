"""What can be told without touch is found where it was put, and not where it was not."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.stats import binomtest
from solidtouch.analysis.audit.leakage.run import (
    BEFORE,
    OFFSET,
    TARED,
    WHOLE,
    accuracy_interval,
    leakage,
    with_samples,
)
from solidtouch.hardware.simulator.session import simulate_session
from solidtouch.hardware.simulator.settings import ICUB_FINGERTIP, PAPER_RODS, preset
from solidtouch.models.errors import InputError
from solidtouch.models.io.load import load_taps
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.splits import split
from solidtouch.models.taps import TapSet

M, J, K, N = 4, 7, 5, 12


def recorded(*, touch=0.0, drift=0.0, contact=3, blocks=True, offset=None, n=N, sessions=2, J=J, noise=1.0):
    """Training and test session of M objects at one place.

    From sample `contact` on objects differ by `touch` and rise alike by 8; before and after by `drift`. Objects come in
    blocks or in turn. An extra array of offsets differs by `offset`.
    """
    rng = np.random.default_rng(11)
    what = np.tile(np.repeat(np.arange(M), n) if blocks else np.tile(np.arange(M), n), sessions)
    code = rng.normal(size=(3, M, K))
    pressed = (np.arange(J) >= contact)[:, None]
    samples = noise * rng.normal(size=(len(what), J, K)) + drift * code[0, what][:, None]
    samples += pressed * (8.0 + touch * code[1, what][:, None])
    extra = {} if offset is None else {"offset": offset * code[2, what] + rng.normal(size=(len(what), K))}
    taps = TapSet.from_arrays(
        samples,
        what,
        [f"object {m}" for m in range(M)],
        session=np.repeat(np.arange(sessions), M * n),
        trial=np.tile(np.arange(M * n), sessions),
        preprocessing=Preprocessing(samples=J, rate_hz=50.0),
        extra=extra,
    )
    return taps.select(taps.session < sessions - 1), taps.select(taps.session == sessions - 1)


def found(pair, pre: int | None = 3):
    return leakage(*pair, pair[0].grid(), pre=pre)


def accuracy(result, source, quantity="what"):
    return float(result.told["accuracy"].sel(source=source, quantity=quantity))


# Verdicts


def test_drift_that_tells_objects_recorded_in_blocks_explains_them():
    """Objects that differ by drift only are told before contact as well as after, and not at all once tared."""
    result = found(recorded(drift=2.0))

    assert (result.before.samples, result.before.known) == (3, "--pre")
    assert result.explains == {"what": "yes"}
    assert result.explained == ("what",)
    assert accuracy(result, BEFORE) > 0.9
    assert accuracy(result, TARED) < 0.5
    assert float(result.told["lost_low"].sel(quantity="what")) > 0.3
    assert "not evidence of touch" in result.sentences[0]
    assert "less well" in result.sentences[1]
    assert "Recorded in blocks: in sessions 0, 1 the taps of each object are consecutive." in result.sentences[-1]
    assert result.blocks["test session 1"] == {"what": True}


def test_touch_alone_is_not_explained():
    """Samples before contact are at chance, and taring costs next to nothing."""
    result = found(recorded(touch=2.0))

    assert result.explains == {"what": "no"}
    assert result.explained == ()
    assert accuracy(result, WHOLE) > 0.9
    assert abs(accuracy(result, TARED) - accuracy(result, WHOLE)) < 0.1
    low, high = (float(result.told[name].sel(source=BEFORE, quantity="what")) for name in ("low", "high"))
    assert low < float(result.told["chance"].sel(quantity="what")) < high


def test_a_weak_drift_under_strong_touch_explains_a_part():
    result = found(recorded(touch=3.0, drift=0.3, n=60))

    assert result.explains == {"what": "partly"}
    assert "is partly inferred" in result.sentences[0]


def test_offsets_that_were_subtracted_are_evidence_of_blocks_and_no_cause():
    """They identify objects where samples before contact do not; the filter never sees them."""
    result = found(recorded(touch=3.0, offset=4.0))

    assert result.explains == {"what": "no"}
    assert result.explained == ()
    assert accuracy(result, OFFSET) > 0.9
    assert accuracy(result, BEFORE) < 0.5
    (sentence,) = (one for one in result.sentences if "offsets" in one)
    assert "suggest that classes were recorded in blocks" in sentence
    assert "predict the object (1.00" in sentence
    alike = found(recorded(touch=3.0, offset=0.0))
    assert "The subtracted offsets do not differ between classes." in alike.sentences
    without = found(recorded(touch=3.0))
    assert np.isnan(accuracy(without, OFFSET))
    assert not any("offsets" in sentence for sentence in without.sentences)


# What may begin in contact


def pressed(n=30, J=J, hold=0):
    """Indentations whose first sample is already pressed: objects differ from the first sample on, in blocks.

    For `hold` samples nothing changes, as if the finger were not there yet.
    """
    rng = np.random.default_rng(5)
    what = np.tile(np.repeat(np.arange(M), n), 2)
    depth = np.maximum(1.0, 1.0 + np.arange(J) - hold)[:, None]
    samples = 0.1 * rng.normal(size=(len(what), J, K)) + depth * rng.normal(size=(M, 1, K))[what]
    return in_sessions(samples, what, n)


def averaged(n=30):
    """One value of each taxel and push, its average over the push."""
    (train, test), J = pressed(n), 1
    what = np.concatenate([train.what, test.what])
    return in_sessions(np.concatenate([train.taps, test.taps]).mean(axis=1, keepdims=True), what, n, J)


def in_sessions(samples, what, n, J=J, record: Preprocessing | None = None):
    taps = TapSet.from_arrays(
        samples,
        what,
        [f"object {m}" for m in range(M)],
        session=np.repeat([0, 1], M * n),
        trial=np.tile(np.arange(M * n), 2),
        preprocessing=record or Preprocessing(samples=J),
    )
    return taps.select(taps.session == 0), taps.select(taps.session == 1)


@pytest.mark.parametrize(
    "made", [pressed, partial(pressed, hold=3), averaged], ids=["pressed at once", "pressed and held", "averages"]
)
def test_taps_that_may_begin_in_contact_are_not_judged(made):
    """Their first sample identifies objects as well as whole taps, and that is touch."""
    result = found(made(), pre=None)

    assert accuracy(result, WHOLE) > 0.9
    assert result.explains == {"what": "cannot be judged"}
    assert result.explained == ()
    assert "cannot be assessed: taps may begin in contact" in result.unjudged
    assert result.sentences[0] == result.unjudged
    assert not any("Without touch" in sentence or "not evidence of touch" in sentence for sentence in result.sentences)


def test_a_stretch_in_which_classes_do_not_part_is_a_hint_only():
    """Drift and touch look the same in it, so the user has to say which it is; then it is judged."""
    pair = recorded(drift=2.0)
    result = found(pair, pre=None)

    assert result.explains == {"what": "cannot be judged"}
    assert "first 3 samples" in result.unjudged
    assert "use --pre 3." in result.unjudged
    assert found(pair).unjudged == ""


def with_record(pair, **fields):
    record = Preprocessing(samples=J, rate_hz=50.0, **fields)
    return tuple(TapSet(taps.dataset.assign_attrs(preprocessing=record.to_json())) for taps in pair)


def test_samples_before_a_press_are_known_by_the_record():
    """As many as the record says; --pre says otherwise, and 0 says that taps begin in contact."""
    pair = with_record(recorded(drift=2.0), trigger="press", pre_samples=2)
    result = found(pair, pre=None)

    assert (result.before.samples, result.before.known) == (2, "press")
    assert result.explains == {"what": "yes"}
    assert "The first 2 samples of each tap precede the press and therefore contact." in result.sentences
    assert found(pair, pre=1).before[:2] == (1, "--pre")
    assert found(pair, pre=0).explains == {"what": "cannot be judged"}


def test_light_touch_before_the_trigger_level_is_not_taken_for_leakage():
    """Before a contact trigger only samples count in which classes do not part."""
    drift = with_record(recorded(drift=2.0), trigger="contact", trigger_level=4.0, pre_samples=5)
    touched = with_record(pressed(), trigger="contact", trigger_level=4.0, pre_samples=2)

    assert found(drift, pre=None).before[:2] == (3, "contact")
    assert found(drift, pre=None).explains == {"what": "yes"}
    assert found(touched, pre=None).explains == {"what": "cannot be judged"}
    assert "before the trigger level is reached" in found(touched, pre=None).unjudged


@pytest.mark.parametrize(
    ("made", "pre", "message"),
    [
        (pressed, J, "--pre 7: taps have 7 samples; at most 6 can be before contact"),
        (pressed, -1, "--pre -1: taps have 7 samples"),
        (averaged, 1, "--pre 1: taps have 1 sample, which cannot be before contact"),
    ],
    ids=["all", "negative", "one sample"],
)
def test_more_samples_than_taps_have_are_refused(made, pre, message):
    with pytest.raises(InputError, match=message):
        found(made(), pre=pre)


def test_few_taps_or_no_touch_are_said_to_be_so():
    """Two test taps per object are too few; taps of noise tell nothing that could be explained."""
    train, test = recorded(drift=2.0)
    few = found((train, test.select(np.arange(0, len(test), 6))))
    noise = found(recorded())

    assert few.explains == {"what": "not enough data"}
    assert "too few test taps" in few.sentences[0]
    assert noise.explains == {"what": "nothing to explain"}
    assert "no better than chance" in noise.sentences[0]


def small_rig(**changes):
    """Two sessions of three rods along 4 mm."""
    rig = replace(preset("paper"), rods=PAPER_RODS[::2], taxels=ICUB_FINGERTIP[::2], start_mm=6.0, end_mm=10.0)
    rig = replace(rig, **changes)
    return simulate_session(rig, 4, 0), simulate_session(rig, 4, 1)


def test_a_high_pass_brings_former_taps_into_samples_before_contact():
    """They tell rod and position, as touch; without the filter nothing is told before contact."""
    filtered, plain = found(small_rig(), pre=12), found(small_rig(highpass_hz=0.0), pre=12)

    assert filtered.explains == dict.fromkeys(("what", "where", "joint"), "former taps")
    assert filtered.explained == ()
    assert accuracy(filtered, BEFORE, "where") > 0.5
    assert "hold traces of earlier taps" in filtered.sentences[0]
    assert not {"yes", "mostly", "partly", "former taps"} & set(plain.explains.values())
    assert accuracy(plain, BEFORE, "where") < 0.35


def test_chance_is_the_better_of_an_even_guess_and_the_most_frequent_class():
    """Of objects tapped 30, 10, 10 and 10 times, always saying the first is right in half of all taps."""
    train, test = recorded(touch=2.0, n=30)
    often = np.concatenate([np.flatnonzero(test.what == m)[: 30 if m == 0 else 10] for m in range(M)])
    even, uneven = (found((train, one)).told["chance"].sel(quantity="what") for one in (test, test.select(often)))

    assert float(even) == 0.25
    assert float(uneven) == 0.5


# Numbers


def test_intervals_are_wilsons_where_no_class_repeats(rng):
    """With classes of which all taps are right or all wrong, one class counts as one tap."""
    right = rng.random(60) < 0.8
    expected = binomtest(int(right.sum()), 60).proportion_ci(0.95, "wilson")
    low, high = accuracy_interval(right, np.arange(60))

    assert (low, high) == pytest.approx((expected.low, expected.high), abs=2e-3)
    assert accuracy_interval(np.repeat(right, 7), np.repeat(np.arange(60), 7)) == pytest.approx((low, high), abs=2e-3)
    assert accuracy_interval(np.ones(20, bool), np.arange(20)) == pytest.approx((20 / (20 + 1.96**2), 1.0), abs=1e-4)


def test_the_same_seed_gives_the_same_intervals():
    pair = recorded(touch=2.0, drift=0.5)
    one, same = (leakage(*pair, pair[0].grid(), seed=3, pre=3) for _ in range(2))

    assert one.told.equals(same.told)
    assert one.sentences == same.sentences


def test_test_taps_of_untrained_classes_are_left_out():
    train, test = recorded(touch=2.0)
    result = leakage(train.select(train.what != 1), test, train.grid())

    assert result.test_taps == (M - 1) * N
    with pytest.raises(InputError, match="No test tap belongs to a class with a training tap"):
        leakage(train.select(train.what == 1), test.select(test.what == 2), train.grid())
    with pytest.raises(InputError, match="differ in preprocessing"):
        leakage(train, with_samples(test, test.taps[:, :3]), train.grid())


# Recorded data, see the README beside them


def on_recorded(shared_data, name, pre: int | None = None, **cells):
    taps = load_taps(shared_data / f"{name}.npz")
    grid = taps.grid(**cells)
    fold = split(taps, grid).folds[0]
    return leakage(fold.train, fold.test, grid, pre=pre)


def test_whether_the_first_sample_of_icub_grasp_is_touch_is_not_known(shared_data):
    """It identifies the objects; only if it is said to precede contact that is leakage."""
    assert on_recorded(shared_data, "icub_grasp").explains == {"what": "cannot be judged"}
    result = on_recorded(shared_data, "icub_grasp", pre=1)
    assert result.explains == {"what": "yes"}
    assert accuracy(result, BEFORE) >= 0.92


def test_offsets_infer_the_objects_of_the_barrett_hand_and_not_the_positions(shared_data):
    """Which is evidence of blocks and explains nothing."""
    boxes, balls = (on_recorded(shared_data, name) for name in ("barrett_boxes", "barrett_ballcyl"))

    assert accuracy(boxes, OFFSET) > 0.9
    assert accuracy(balls, OFFSET) > 0.6
    for result in (boxes, balls):
        assert result.explained == ()
        assert accuracy(result, OFFSET, "where") < 0.3
        (sentence,) = (one for one in result.sentences if "offsets" in one)
        assert "predict the object" in sentence


def test_eflesh_grid_and_braille_are_not_judged(shared_data):
    """One has one sample per tap; the other slides, and changes at once."""
    grid = on_recorded(shared_data, "eflesh_grid", where_cell="3mm", what_cell="3mm")
    letters = on_recorded(shared_data, "braille_icub")

    assert set(grid.explains.values()) == set(letters.explains.values()) == {"cannot be judged"}
    assert not any(any(of.values()) for of in grid.blocks.values())
    assert "Classes were not recorded in blocks." in grid.sentences
    assert "with one sample per tap" in grid.sentences[0]
