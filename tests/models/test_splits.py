"""Which taps train and which test."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from solidtouch.models.errors import InputError
from solidtouch.models.io.load import load_taps
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.settings import Division
from solidtouch.models.splits import load_experiment, parse_sessions, split, two_files
from solidtouch.models.taps import TapSet


def numbered(what, session=None, trial=None, where=None):
    """Taps whose one sample is their number in the file."""
    samples = np.arange(len(what), dtype=float).reshape(-1, 1, 1)
    names = [f"object {m}" for m in range(max(what) + 1)]
    return TapSet.from_arrays(
        samples, what, names, where=where, session=session, trial=trial, preprocessing=Preprocessing(samples=1)
    )


def numbers(taps):
    return taps.taps.ravel().astype(int).tolist()


def sides(taps, *arguments, **more):
    fold = split(taps, taps.grid(), *arguments, **more).folds[0]
    return numbers(fold.train), numbers(fold.test)


TAPS = st.lists(
    st.tuples(st.integers(0, 3), st.integers(0, 2), st.integers(0, 4), st.integers(0, 9)), min_size=2, max_size=40
)


@given(rows=TAPS, method=st.sampled_from(["halves", "parity"]))
def test_halves_and_parity_partition_the_taps_of_each_class(rows, method):
    """No tap is lost or on both sides, and each class trains with as many taps as it tests, or one more."""
    what, where, session, trial = (np.array(column) for column in zip(*rows, strict=True))
    taps = numbered(what, session, trial, where)
    key = where * 10 + what
    if len(np.unique(key)) == len(rows):
        with pytest.raises(InputError, match="No tap left to test"):
            sides(taps, method)
        return
    train, test = sides(taps, method)

    assert sorted(train + test) == list(range(len(rows)))
    for value in np.unique(key):
        members = set(np.flatnonzero(key == value).tolist())
        assert len(members & set(train)) - len(members & set(test)) in (0, 1)


@given(rows=TAPS)
def test_every_tap_of_the_first_half_was_recorded_before_those_of_the_second(rows):
    what, where, session, trial = (np.array(column) for column in zip(*rows, strict=True))
    key = where * 10 + what
    if len(np.unique(key)) == len(rows):
        return
    train, test = sides(numbered(what, session, trial, where), "halves")

    for value in np.unique(key):
        order = {i: (session[i], trial[i], i) for i in np.flatnonzero(key == value).tolist()}
        earlier, later = ([order[i] for i in side if i in order] for side in (train, test))
        assert not later or max(earlier) < min(later)


@given(rows=TAPS)
def test_leaving_each_session_out_tests_every_tap_once(rows):
    what, where, session, trial = (np.array(column) for column in zip(*rows, strict=True))
    taps = numbered(what, session, trial, where)
    if len(np.unique(session)) == 1:
        with pytest.raises(InputError, match="No tap left to train with"):
            split(taps, taps.grid(), "leave-one-session-out")
        return
    folds = split(taps, taps.grid(), "leave-one-session-out").folds

    assert sorted(n for fold in folds for n in numbers(fold.test)) == list(range(len(rows)))
    for fold in folds:
        assert sorted(numbers(fold.train) + numbers(fold.test)) == list(range(len(rows)))
        assert not set(fold.train.session) & set(fold.test.session)


def test_recorded_order_is_session_then_trial_then_place_in_the_file():
    taps = numbered([0] * 6, session=[1, 0, 0, 1, 0, 0], trial=[0, 5, 2, 0, 2, 9])

    assert sides(taps, "halves") == ([1, 2, 4], [0, 3, 5])
    assert sides(taps, "parity") == ([0, 1, 2], [3, 4, 5])


def test_the_last_of_several_sessions_tests():
    taps = numbered([0, 0, 0, 0], session=[2, 7, 2, 4])
    parts = split(taps, taps.grid())

    assert (parts.method, parts.warning) == ("sessions", "")
    assert parts.description == "Sessions 2, 4 train, session 7 tests."
    assert sides(taps) == ([0, 2, 3], [1])


@pytest.mark.parametrize(
    ("train", "test", "expected"),
    [
        (None, [2], ([1, 3], [0, 2])),
        ([4], None, ([3], [0, 1, 2])),
        ([7, 4], [2], ([1, 3], [0, 2])),
        ([4], [7], ([3], [1])),
    ],
)
def test_sessions_can_be_named(train, test, expected):
    taps = numbered([0, 0, 0, 0], session=[2, 7, 2, 4])

    assert sides(taps, None, train, test) == expected


def test_one_session_is_split_by_parity_with_a_warning():
    taps = numbered([0, 1, 0, 1, 0])
    parts = split(taps, taps.grid())

    assert parts.method == "parity"
    assert "same session" in parts.warning
    assert sides(taps) == ([0, 1, 4], [2, 3])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("thirds",), "--split must be one of sessions, leave-one-session-out, halves, parity, got 'thirds'"),
        ((None, [3], None), "--train: no session 3; the data have sessions 2, 4, 7"),
        ((None, None, [0]), "--test: no session 0"),
        ((None, [2, 4], [4]), "Session 4 cannot be in both --train and --test"),
        ((None, None, [2, 4, 7]), "No tap left to train with: the data have sessions 2, 4, 7"),
        ((None, [2, 4, 7], None), "No tap left to test"),
        (("parity", [2], None), "--train and --test cannot be combined with --split parity"),
        (("halves",), "No tap left to test: no class has more than one tap"),
    ],
)
def test_splits_that_cannot_be_made_are_refused(arguments, message):
    taps = numbered([0, 1, 2], session=[2, 7, 4])
    with pytest.raises(InputError, match=message):
        split(taps, taps.grid(), *arguments)


def test_one_session_has_none_to_spare():
    taps = numbered([0, 0])
    for method in ("sessions", "leave-one-session-out"):
        with pytest.raises(InputError, match=r"No tap left to train with: the data have session 0"):
            split(taps, taps.grid(), method)


def test_cells_decide_what_a_class_is(make_taps):
    """With 3 mm cells two positions share a class, and its taps are halved together."""
    taps = make_taps(L=4, M=1, sessions=1, repeats=1)
    with pytest.raises(InputError, match="no class has more than one tap"):
        split(taps, taps.grid(), "halves")
    fold = split(taps, taps.grid("3mm"), "halves").folds[0]

    assert (fold.train.trial.tolist(), fold.test.trial.tolist()) == ([0, 2], [1, 3])


def test_two_files_train_and_test(make_taps, tmp_path):
    make_taps(repeats=1).save(tmp_path / "a.nc")
    make_taps(repeats=2, seed=1).save(tmp_path / "b.nc")
    parts, grid = load_experiment([tmp_path / "a.nc", tmp_path / "b.nc"], Division(where_cell="3mm"))

    assert (len(parts.folds[0].train), len(parts.folds[0].test)) == (24, 48)
    assert parts.method == "files"
    assert grid.shape == (2, 4)


def test_one_file_is_split_as_the_options_say(make_taps, tmp_path):
    make_taps(sessions=3, repeats=1).save(tmp_path / "a.nc")
    parts, grid = load_experiment([tmp_path / "a.nc"], Division(train="0,2", test="1"))

    assert parts.description == "Sessions 0, 2 train, session 1 tests."
    assert grid.shape == (3, 4)


def test_files_and_options_that_do_not_go_together_are_refused(make_taps, tmp_path):
    a, b, far = tmp_path / "a.nc", tmp_path / "b.nc", tmp_path / "far.nc"
    make_taps(repeats=1).save(a)
    make_taps(repeats=1).save(b)
    make_taps(repeats=1, where=np.full(24, 99.0), where_value=[99.0]).save(far)
    for data, options, message in (
        ([], {}, "Give one data file, or two \\(TRAIN and TEST\\), got 0"),
        ([a, b, a], {}, "got 3"),
        ([a, b], {"split": "halves"}, "--split splits one file"),
        ([a, b], {"train": "0"}, "--train splits one file"),
        ([a, b], {"test": "0"}, "--test splits one file"),
        ([a, far], {}, r"No tap left to test: none of .*far\.nc belongs to a class of .*a\.nc"),
        ([a], {"test": "one"}, "--test must be session numbers such as 0,1, got 'one'"),
        ([a], {"train": ""}, "--train must be session numbers"),
    ):
        with pytest.raises(InputError, match=message):
            load_experiment(data, Division(**options))


def test_files_of_another_sensor_are_refused(make_taps):
    with pytest.raises(InputError, match="TRAIN has 5 taxels and TEST has 7"):
        two_files(make_taps(), make_taps(K=7))


def test_session_lists_are_read():
    assert parse_sessions("0, 2,10", "--train") == [0, 2, 10]
    assert parse_sessions(None, "--train") is None


@pytest.mark.parametrize(
    ("name", "method", "train", "test"),
    [
        ("barrett_ballcyl", "sessions", 72, 36),
        ("barrett_boxes", "sessions", 103, 26),
        ("eflesh_grid", "sessions", 4805, 4805),
        ("icub_grasp", "sessions", 90, 89),
        ("braille_icub", "sessions", 270, 270),
    ],
)
def test_recorded_data_are_split_by_session(name, method, train, test, shared_data):
    taps = load_taps(shared_data / f"{name}.npz")
    parts = split(taps, taps.grid())

    assert (parts.method, len(parts.folds[0].train), len(parts.folds[0].test)) == (method, train, test)
