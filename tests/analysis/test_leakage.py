"""What can be told without touch is found where it was put, and not where it was not."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binomtest
from solidtouch.analysis.leakage import (
    BEFORE,
    OFFSET,
    TARED,
    WHOLE,
    accuracy_interval,
    leading_samples,
    leakage,
    with_samples,
)
from solidtouch.hardware.data_collection import simulate_session
from solidtouch.hardware.fingertip_layout import ICUB_FINGERTIP
from solidtouch.hardware.presets import preset
from solidtouch.hardware.simulation_settings import PAPER_RODS
from solidtouch.models.errors import InputError
from solidtouch.models.importers import load_taps
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


def found(pair):
    return leakage(*pair, pair[0].grid())


def accuracy(result, source, quantity="what"):
    return float(result.told["accuracy"].sel(source=source, quantity=quantity))


# Samples before contact


@pytest.mark.parametrize("contact", [2, 3, 5])
@pytest.mark.parametrize("noise", [0.01, 0.3, 1.0])
def test_samples_before_contact_end_where_classes_part(contact, noise):
    """A fifth earlier, to be sure; noise does not move the place, and neither does a level that objects start from."""
    train, _ = recorded(touch=8.0, drift=3.0, contact=contact, n=40, noise=noise)
    lead = leading_samples(train.taps, train.what)

    assert (lead.samples, lead.kind) == (np.ceil(0.8 * contact), "stretch")
    assert lead.class_change[contact] > 0.3
    assert np.abs(lead.class_change[:contact]).max() < 1e-3


def test_a_press_that_rises_at_once_leaves_the_first_sample(rng):
    """Classes part from the second sample on, a little at a time."""
    what = np.repeat(np.arange(M), N)
    rise = np.arange(9.0)[:, None] * rng.normal(size=(M, 1, K))[what]
    lead = leading_samples(rise + 0.01 * rng.normal(size=rise.shape), what)

    assert (lead.samples, lead.kind) == (1, "first sample")


def test_exchangeable_samples_have_none_before_contact(rng):
    """So it is with taps drawn from a model of the paper's kind, and with one sample per tap."""
    what = np.repeat(np.arange(M), N)
    samples = rng.normal(size=(M * N, 6, K)) + 5.0 * what[:, None, None]

    assert leading_samples(samples, what)[:2] == (0, "none")
    assert leading_samples(samples[:, :1], what)[:2] == (0, "none")
    assert leading_samples(np.ones_like(samples), what)[:2] == (0, "none")


def test_without_repeated_classes_noise_counts_as_change(rng):
    """A stretch is then found too short rather than too long."""
    samples = 0.1 * rng.normal(size=(8, 6, K))
    samples[:, 4:] += 10.0

    assert leading_samples(samples, np.arange(8))[:2] == (4, "stretch")
    assert leading_samples(samples + 2 * rng.normal(size=samples.shape), np.arange(8)).samples < 4


# Verdicts


def test_drift_that_tells_objects_recorded_in_blocks_explains_them():
    """Objects that differ by drift only are told before contact as well as after, and not at all once tared."""
    result = found(recorded(drift=2.0))

    assert result.lead.samples == 3
    assert result.explains == {"what": "yes"}
    assert result.explained == ("what",)
    assert accuracy(result, BEFORE) > 0.9
    assert accuracy(result, TARED) < 0.5
    assert float(result.told["lost_low"].sel(quantity="what")) > 0.3
    assert "no evidence of touch" in result.sentences[0]
    assert "less well" in result.sentences[1]
    assert "Recorded in blocks: in training session 0, test session 1" in result.sentences[-1]
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
    assert "is partly told" in result.sentences[0]


def test_offsets_that_were_subtracted_are_looked_at():
    """They tell objects where samples do not, and stand beside them."""
    result = found(recorded(touch=3.0, offset=4.0))

    assert result.explains == {"what": "yes"}
    assert accuracy(result, OFFSET) > 0.9
    assert accuracy(result, BEFORE) < 0.5
    assert np.isnan(accuracy(found(recorded(touch=3.0)), OFFSET))


@pytest.mark.parametrize(("blocks", "verdict"), [(True, "yes"), (False, "touch already")])
def test_a_first_sample_is_drift_only_where_classes_came_in_blocks(blocks, verdict, rng):
    """Objects tapped in turn share all drift, so a first sample that tells them is the beginning of touch."""
    train, test = recorded(drift=4.0, blocks=blocks)
    rise = np.arange(J)[:, None] * rng.normal(size=(M, 1, K))

    def rising(taps):
        return with_samples(taps, taps.taps + 3 * rise[taps.what])

    result = found((rising(train), rising(test)))

    assert result.lead.kind == "first sample"
    assert result.explains == {"what": verdict}
    assert result.explained == (("what",) if blocks else ())


def test_exchangeable_taps_are_accused_of_nothing():
    """Objects told by each sample alike, in blocks: there is nothing before contact to tell them from."""
    train, test = recorded(drift=4.0, touch=0.0, contact=J)
    result = found((train, test))

    assert result.lead.kind == "none"
    assert result.explains == {"what": "no"}
    assert "no samples before contact" in result.sentences[0]


def test_few_taps_or_no_touch_are_said_to_be_so():
    """Two test taps per object are too few; taps of noise tell nothing that could be explained."""
    train, test = recorded(drift=2.0)
    few = found((train, test.select(np.arange(0, len(test), 6))))
    noise = found(recorded())

    assert few.explains == {"what": "not enough data"}
    assert "not enough test taps" in few.sentences[0]
    assert noise.explains == {"what": "nothing to explain"}
    assert "no better than chance" in noise.sentences[0]


def small_rig(**changes):
    """Two sessions of three rods along 4 mm."""
    rig = replace(preset("paper"), rods=PAPER_RODS[::2], taxels=ICUB_FINGERTIP[::2], start_mm=6.0, end_mm=10.0)
    rig = replace(rig, **changes)
    return simulate_session(rig, 4, 0), simulate_session(rig, 4, 1)


def test_a_high_pass_brings_former_taps_into_samples_before_contact():
    """They tell rod and position, as touch; without the filter nothing is told before contact."""
    filtered, plain = found(small_rig()), found(small_rig(highpass_hz=0.0))

    assert filtered.explains == dict.fromkeys(("what", "where", "joint"), "former taps")
    assert filtered.explained == ()
    assert filtered.lead.kind == "stretch"
    assert accuracy(filtered, BEFORE, "where") > 0.5
    assert "not without touch" in filtered.sentences[0]
    assert not {"yes", "mostly", "partly", "former taps"} & set(plain.explains.values())
    assert accuracy(plain, BEFORE, "where") < 0.35
    assert plain.lead.samples >= filtered.lead.samples


def test_contact_of_the_rig_begins_after_the_leading_samples():
    """The finger touches after 0.25 s, which is sample 12.5."""
    for changes in ({}, {"highpass_hz": 0.0}, {"common_noise_counts": 6.0}):
        train, _ = small_rig(**changes)
        where, what = train.indices(train.grid())
        assert 5 <= leading_samples(train.taps, where * 3 + what).samples <= 12


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
    one, same = (leakage(*pair, pair[0].grid(), seed=3) for _ in range(2))

    assert one.told.equals(same.told)
    assert one.sentences == same.sentences


def test_test_taps_of_untrained_classes_are_left_out():
    train, test = recorded(touch=2.0)
    result = leakage(train.select(train.what != 1), test, train.grid())

    assert result.test_taps == (M - 1) * N
    with pytest.raises(InputError, match="No test tap belongs to a class with a training tap"):
        leakage(train.select(train.what == 1), test.select(test.what == 2), train.grid())
    with pytest.raises(InputError, match="prepared differently"):
        leakage(train, with_samples(test, test.taps[:, :3]), train.grid())


# Recorded data, see the README beside them


def on_recorded(shared_data, name, **cells):
    taps = load_taps(shared_data / f"{name}.npz")
    grid = taps.grid(**cells)
    fold = split(taps, grid).folds[0]
    return leakage(fold.train, fold.test, grid)


def test_the_first_sample_tells_the_objects_of_icub_grasp(shared_data):
    result = on_recorded(shared_data, "icub_grasp")

    assert result.explains == {"what": "yes"}
    assert accuracy(result, BEFORE) >= 0.92
    assert "may be touch already" in " ".join(result.sentences)


def test_offsets_tell_the_objects_of_the_barrett_hand_and_not_the_positions(shared_data):
    boxes, balls = (on_recorded(shared_data, name) for name in ("barrett_boxes", "barrett_ballcyl"))

    assert boxes.explains["what"] == "yes"
    assert balls.explains["what"] in ("yes", "mostly")
    assert accuracy(boxes, OFFSET) > 0.9
    assert accuracy(balls, OFFSET) > 0.6
    for result in (boxes, balls):
        assert "where" not in result.explained
        assert "joint" not in result.explained
        assert accuracy(result, OFFSET, "where") < 0.3


def test_eflesh_grid_and_braille_have_nothing_before_contact(shared_data):
    """One is interleaved with one sample per tap; the other slides, and changes at once."""
    grid = on_recorded(shared_data, "eflesh_grid", where_cell="3mm", what_cell="3mm")
    letters = on_recorded(shared_data, "braille_icub")

    assert set(grid.explains.values()) == set(letters.explains.values()) == {"no"}
    assert not any(any(of.values()) for of in grid.blocks.values())
    assert "Classes were not recorded in blocks." in grid.sentences
    assert "There are no samples free of contact" in letters.sentences[1]
