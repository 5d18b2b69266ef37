"""Taps of different lengths, aligned and made of one length."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from solidtouch.models.cutting.ragged import even_taps
from solidtouch.models.errors import InputError

DROP = "; commands read them with --missing drop."


def bumps(*shapes):
    """Taps of two taxels from (samples, place of a bump of 4 and 5); place `None` for none."""
    taps = []
    for samples, place in shapes:
        tap = np.zeros((samples, 2))
        if place is not None:
            tap[place] = [4.0, 5.0]
        taps.append(tap)
    return taps


TAPS = [np.arange(2.0 * n).reshape(n, 2) for n in (3, 5, 4)]


def test_the_shortest_gives_the_length():
    even = even_taps(TAPS)

    assert even.samples.tolist() == [tap[:3].tolist() for tap in TAPS]
    assert (even.left_out, even.missing) == (("2 taps cut to 3 samples.",), "refuse")
    assert even.kept.tolist() == [0, 1, 2]


def test_the_longest_gives_the_length_and_others_lack_samples_at_the_end():
    even = even_taps(TAPS, "longest")

    assert even.samples.shape == (3, 5, 2)
    assert np.isnan(even.samples).sum(axis=(1, 2)).tolist() == [4, 0, 2]
    np.testing.assert_array_equal(even.samples[2, :4], TAPS[2])
    assert (even.left_out, even.missing) == (
        (f"2 taps filled with NaN to 5 samples{DROP}",),
        "drop",
    )


def test_of_a_given_length_longer_taps_are_cut_and_shorter_ones_filled_or_left_out():
    filled, fewer = even_taps(TAPS, 4), even_taps(TAPS, 4, short="leave out")

    assert filled.left_out == (
        "1 tap cut to 4 samples.",
        f"1 tap filled with NaN to 4 samples{DROP}",
    )
    assert np.isnan(filled.samples).sum(axis=(1, 2)).tolist() == [2, 0, 0]
    assert fewer.kept.tolist() == [1, 2]
    assert fewer.samples.tolist() == [TAPS[1][:4].tolist(), TAPS[2].tolist()]
    assert fewer.left_out == ("1 tap left out: shorter than 4 samples.", "1 tap cut to 4 samples.")


@pytest.mark.parametrize(("align", "level"), [("contact", 4.5), ("peak", 0.0)])
def test_contact_or_peak_falls_on_the_same_sample(align, level):
    even = even_taps(bumps((9, 3), (7, 2), (8, 1), (6, None), (0, None)), align=align, level=level, pre=2)

    assert even.kept.tolist() == [0, 1]
    assert even.samples.shape == (2, 7, 2)
    assert even.samples.argmax(axis=1).tolist() == [[2, 2], [2, 2]]
    without = "without a sample at the level 4.5" if level else "without a sample that differs from the first one"
    assert even.left_out == (
        f"2 taps left out: {without}.",
        f"1 tap left out: with fewer than 2 samples before {align}.",
        "1 tap cut to 7 samples.",
    )


def test_contact_is_the_first_sample_at_the_level_also_of_values_that_fall():
    tap = np.array([[0.0, 1], [-2, 1], [-1, -3], [-9, -9]])

    assert even_taps([tap], align="contact", level=-2.0, pre=1).samples.tolist() == [tap.tolist()]
    assert even_taps([tap], align="contact", level=-3.0).samples.tolist() == [tap[2:].tolist()]


def test_a_peak_is_the_largest_change_of_all_taxels_together():
    """Not of one taxel, in either direction, and from the first sample, not from zero."""
    tap = np.array([[9.0, 9], [9, 2], [5, 13], [9, 9]])

    assert even_taps([tap], align="peak").samples.tolist() == [tap[2:].tolist()]


def test_missing_samples_do_not_touch_and_are_no_peak():
    tap = np.array([[0.0, 0], [np.nan, 1], [4, 4], [np.nan, np.nan]])

    assert len(even_taps([tap], align="contact", level=4.0).samples[0]) == 2
    assert len(even_taps([tap], align="peak").samples[0]) == 2
    assert even_taps([tap]).missing == "drop"


@given(
    st.lists(st.tuples(st.integers(1, 9), st.integers(0, 8)), min_size=1, max_size=6),
    st.integers(0, 3),
    st.sampled_from(["shortest", "longest", 3]),
)
def test_every_tap_is_kept_or_counted(shapes, pre, length):
    taps = bumps(*((samples, place if place < samples else None) for samples, place in shapes))
    can = [n for n, (samples, place) in enumerate(shapes) if place < samples and place >= pre]
    if not can:
        with pytest.raises(InputError, match="no tap is left"):
            even_taps(taps, length, align="contact", level=5.0, pre=pre)
        return
    even = even_taps(taps, length, align="contact", level=5.0, pre=pre)

    assert even.kept.tolist() == can
    counts = {
        word: sum(int(text.split()[0]) for text in even.left_out if word in text) for word in ("left", "cut", "fill")
    }
    lengths = np.array([shapes[n][0] - shapes[n][1] + pre for n in can])
    J = {"shortest": lengths.min(), "longest": lengths.max(), 3: 3}[length]
    assert even.samples.shape == (len(can), J, 2)
    assert (~np.isnan(even.samples[:, :, 0])).sum(axis=1).tolist() == np.minimum(lengths, J).tolist()
    assert counts == {"left": len(taps) - len(can), "cut": (lengths > J).sum(), "fill": (lengths < J).sum()}


def test_kinds_of_numbers_are_kept():
    assert even_taps([np.ones((2, 1), np.float32)]).samples.dtype == np.float32
    assert even_taps([np.ones((2, 1), np.int64)]).samples.dtype == np.float64


@pytest.mark.parametrize(
    ("taps", "more", "message"),
    [
        ([], {}, "there are no taps"),
        ([np.zeros(3)], {}, r"tap 0 must have shape \(samples, taxels\), got \(3,\)"),
        ([np.zeros((3, 2)), np.zeros((3, 4))], {}, "tap 1 has 4 taxels, tap 0 2"),
        (TAPS, {"length": "mean"}, "length must be an integer of at least 1, got 'mean'"),
        (TAPS, {"length": 0}, "length must be an integer of at least 1, got 0"),
        (TAPS, {"align": "end"}, "align must be none, contact or peak, got 'end'"),
        (TAPS, {"align": "contact"}, "align='contact' does not match level=0.0"),
        (TAPS, {"align": "peak", "level": 1.0}, "align='peak' does not match level=1.0"),
        (TAPS, {"pre": 1}, "pre=1 needs an alignment"),
        (TAPS, {"align": "peak", "pre": -1}, "pre must be an integer of at least 0"),
        (TAPS, {"short": "keep"}, "short must be fill or leave out, got 'keep'"),
        (TAPS, {"length": 9, "short": "leave out"}, "no tap is left of 3. 3 taps left out: shorter than 9 samples"),
        ([np.zeros((0, 2))], {}, "no tap is left of 1. 1 tap left out: without any sample"),
    ],
)
def test_what_cannot_be_made_even_is_refused(taps, more, message):
    with pytest.raises(InputError, match=message):
        even_taps(taps, **more)
