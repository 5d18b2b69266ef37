"""Every tap of an audit has one purpose, and sessions of different files stay apart."""

import numpy as np
import pytest
from solidtouch.analysis.experiment.parts import audit_parts, load_parts
from solidtouch.models.errors import InputError
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.settings import Division
from solidtouch.models.taps import concatenate

L, M, REPEATS = 3, 4, 7


def files(make_taps, number, **more):
    """One session of 84 taps each, no two alike."""
    return [make_taps(sessions=1, repeats=REPEATS, seed=seed, **more) for seed in range(number)]


def parts_of(sets, **more):
    return audit_parts(sets, [f"file-{i}.nc" for i in range(len(sets))], sets[0].grid(), **more)


def in_class(taps):
    """How many taps of each class, shape (L, M)."""
    return np.bincount(taps.indices(taps.grid())[0] * M + taps.what, minlength=L * M)


def test_the_first_file_trains_and_the_last_measures(make_taps):
    """Those between tune, one by one."""
    sets = files(make_taps, 5)
    parts = parts_of(sets)
    for part, original in zip((parts.train, *parts.tune, parts.measure), sets, strict=True):
        np.testing.assert_array_equal(part.taps, original.taps)
    assert not parts.halved
    assert parts.warnings == ()
    assert parts.session_names == tuple(f"file-{i}.nc" for i in range(5))
    assert parts.description == "file-0.nc trains, file-1.nc, file-2.nc, file-3.nc tune, file-4.nc measures."


def test_of_two_files_the_second_is_halved_by_trial(make_taps):
    """Of the seven taps of each class the odd ones tune, the even ones measure, and the audit says so."""
    sets = files(make_taps, 2)
    parts = parts_of(sets)
    np.testing.assert_array_equal(parts.train.taps, sets[0].taps)
    assert in_class(parts.tune[0]).tolist() == [4] * L * M
    assert in_class(parts.measure).tolist() == [3] * L * M
    both = np.concatenate([parts.tune[0].taps, parts.measure.taps])
    np.testing.assert_array_equal(np.sort(both, axis=0), np.sort(sets[1].taps, axis=0))
    assert parts.halved
    assert "the odd and even taps of the same session" in parts.warnings[0]


def test_halves_go_by_trial_and_not_by_the_order_of_the_file(make_taps, rng):
    """A file with shuffled taps gives the same halves."""
    sets = files(make_taps, 2)
    shuffled = [sets[0], sets[1].select(rng.permutation(len(sets[1])))]
    for one, other in zip(parts_of(sets).tune, parts_of(shuffled).tune, strict=True):
        assert set(one.trial) == set(other.trial)


ONE_FILE = {
    "one session": (1, (4, 2, 1), True, ("taps.nc session 0",)),
    "two": (2, (7, 4, 3), True, ("taps.nc session 0", "taps.nc session 1")),
    "three": (3, (7, 7, 7), False, tuple(f"taps.nc session {s}" for s in range(3))),
    "five": (5, (21, 7, 7), False, tuple(f"taps.nc session {s}" for s in range(5))),
}


@pytest.mark.parametrize(("sessions", "taps", "halved", "names"), ONE_FILE.values(), ids=ONE_FILE)
def test_a_single_file_is_divided_by_its_sessions(sessions, taps, halved, names, make_taps):
    """All but the last two train; a single one is divided within classes, half, a quarter and a quarter."""
    taken = make_taps(sessions=sessions, repeats=REPEATS)
    parts = audit_parts([taken], ["taps.nc"], taken.grid())
    assert tuple(set(in_class(part)) for part in (parts.train, *parts.tune, parts.measure)) == tuple({n} for n in taps)
    assert parts.halved is halved
    assert parts.of_one_session is (sessions == 1)
    assert parts.session_names == names
    assert sum(map(len, (parts.train, *parts.tune, parts.measure))) == len(taken)


def test_sessions_of_different_files_never_share_a_number(make_taps):
    """Three files of two sessions each, all numbered 0 and 1, give six numbers in the order of the files."""
    sets = [make_taps(sessions=2, seed=seed) for seed in range(3)]
    parts = parts_of(sets)
    assert [np.unique(part.session).tolist() for part in (parts.train, *parts.tune, parts.measure)] == [
        [0, 1],
        [2, 3],
        [4, 5],
    ]
    assert parts.session_names[3] == "file-1.nc session 1"
    assert len(parts.all_taps) == sum(map(len, sets))
    np.testing.assert_array_equal(parts.all_taps.taps[: len(sets[0])], sets[0].taps)


def test_files_need_not_have_the_same_positions_nor_further_arrays(make_taps):
    """Tables are those of the first file; an array that one file lacks is dropped, one that all have is kept."""
    a, b, c = (
        make_taps(sessions=1, L=L, seed=L, extra={"offset": np.full((28 * L, 5), L), f"only {L}": np.zeros(28 * L)})
        for L in (3, 2, 5)
    )
    parts = parts_of([a, b, c])
    together = parts.all_taps
    assert len(together) == 28 * (3 + 2 + 5)
    assert together.grid().shape == (3, 4)
    assert set(together.dataset.data_vars) == {"taps", "offset"}
    np.testing.assert_array_equal(np.unique(parts.measure.dataset["offset"]), [5])
    np.testing.assert_array_equal(parts.measure.where, c.where)


def test_taps_that_train_neither_tune_nor_measure(make_taps):
    """Whole sessions and single taps; a warning names the file and how many. Tuning taps may measure, which is said."""
    a, b, c = files(make_taps, 3)
    some = concatenate([c, a.select(np.arange(5)), b.select(np.arange(2))])
    parts = parts_of([a, concatenate([b, a.select(np.arange(3))]), some])
    assert (len(parts.tune[0]), len(parts.measure)) == (84, 86)
    assert parts.warnings == (
        "3 of 87 taps of file-1.nc trained the model and are left out; --training-taps keeps them.",
        "5 of 91 taps of file-2.nc trained the model and are left out; --training-taps keeps them.",
        "2 of the 86 measuring taps are also tuning taps.",
    )
    kept = parts_of([a, b, some], training_taps=True)
    assert len(kept.measure) == 91
    assert kept.warnings[0].startswith("5 of 91 taps of file-2.nc trained the model and are kept")
    with pytest.raises(InputError, match=r"^No tap left to test: all 84 taps of file-1\.nc trained the model"):
        parts_of([a, a, c])


def test_what_remains_of_the_second_file_is_halved(make_taps):
    """A session that trains, found again in the second of two files, leaves equal halves of the other."""
    taps = make_taps(sessions=2, repeats=REPEATS)
    first, second = (taps.select(taps.session == s) for s in (0, 1))
    parts, alone = parts_of([first, taps]), parts_of([first, second])
    np.testing.assert_array_equal(parts.tune[0].taps, alone.tune[0].taps)
    np.testing.assert_array_equal(parts.measure.taps, alone.measure.taps)
    assert parts.warnings[0].startswith("All 84 taps of file-1.nc session 0 trained the model and are left out")


def test_a_session_that_stands_twice_in_one_file_is_left_out(make_taps):
    """As it trains, its copy cannot measure."""
    taps = make_taps(sessions=3, repeats=REPEATS)
    copy = taps.select(taps.session == 0)
    copy = type(copy)(copy.dataset.assign_coords(session=("tap", copy.session + 3)))
    with pytest.raises(InputError, match=r"all 84 taps of file-0\.nc session 3 trained the model"):
        parts_of([concatenate([taps, copy])])


def test_files_that_do_not_fit_together_are_refused(make_taps):
    """Other objects, other taxels, another way of preparation, no file."""
    first, second = files(make_taps, 2)
    with pytest.raises(InputError, match="An audit requires at least one file of taps"):
        audit_parts([], [], first.grid())
    renamed = second.dataset.assign_coords(what_name=("what_class", ["a", "b", "c", "d"]))
    with pytest.raises(InputError, match=r"file-1\.nc: objects differ from those of file-0\.nc"):
        parts_of([first, type(first)(renamed)])
    with pytest.raises(InputError, match=r"file-0\.nc has 5 taxels and file-1\.nc has 3"):
        parts_of([first, make_taps(sessions=1, K=3)])
    with pytest.raises(InputError, match="differ in preprocessing"):
        parts_of([first, make_taps(sessions=1, preprocessing=Preprocessing(samples=6, rate_hz=25.0))])


def test_single_taps_cannot_be_halved(make_taps):
    """With one tap of each class in the second of two files, or in the only session."""
    few, many = make_taps(sessions=1, repeats=1, seed=1), make_taps(sessions=1)
    with pytest.raises(InputError, match="no class has two taps in the session to be halved"):
        parts_of([many, few])
    with pytest.raises(InputError, match="no class has two taps in the session to be halved"):
        parts_of([few])
    assert not parts_of([few, few, few], training_taps=True).halved


def test_every_part_has_a_tap_of_a_trained_class(make_taps):
    """Files of other objects than the training taps can neither tune nor measure."""
    a, b, c = files(make_taps, 3)
    a = a.select(a.what < 2)
    with pytest.raises(InputError, match="No tap to tune with: none belongs to a class with a training tap"):
        parts_of([a, b.select(b.what >= 2), c])
    with pytest.raises(InputError, match="No tap to measure: none belongs to a class with a training tap"):
        parts_of([a, b, c.select(c.what >= 2)])
    assert len(parts_of([a, b.select(b.what <= 2), c]).tune[0]) == REPEATS * L * 3


def test_files_are_loaded_with_the_classes_of_the_first(make_taps, tmp_path):
    """Positions are grouped as asked for, and sessions are called by their files."""
    paths = []
    for number, taps in enumerate(files(make_taps, 3)):
        paths.append(tmp_path / f"{number}.nc")
        taps.save(paths[-1])
    parts, grid = load_parts(paths, Division(where_cell="3mm"))
    assert grid.shape == (2, M)
    assert parts.session_names == ("0.nc", "1.nc", "2.nc")
