"""Cells of several taps each, which differ in number or in samples, with the labels of each tap."""

import numpy as np
import pytest
import scipy.io
from solidtouch.models.errors import InputError
from solidtouch.models.io.layouts.mapping import TapMap
from solidtouch.models.io.layouts.tap_set import load_mapped

TRIALS = np.array([[2, 1, 3], [1, 4, 2]])
J, K = 3, 2


def cells(make):
    """A cell array of what `make` gives for each object, position and number of trials."""
    found = np.empty(TRIALS.shape, object)
    for m, l in np.ndindex(*TRIALS.shape):
        found[m, l] = make(m, l, TRIALS[m, l])
    return found


def samples(m, l, trials):
    return 100 * m + 10 * l + np.arange(trials)[:, np.newaxis, np.newaxis] + np.zeros((trials, J, K)) + 0.25


def wanted():
    return [(f"object {m}", 1.5 * l, t) for m, l in np.ndindex(*TRIALS.shape) for t in range(TRIALS[m, l])]


def check(taps):
    """Labels say which tap each one is."""
    found = [(taps.what_name[m], x, t) for m, x, t in zip(taps.what, taps.where, taps.trial, strict=True)]
    assert sorted(found) == wanted()
    number = [100 * int(name[-1]) + 10 * x / 1.5 + t + 0.25 for name, x, t in found]
    assert taps.taps.tolist() == [[[n] * K] * J for n in number]


def saved(folder, **arrays):
    scipy.io.savemat(folder / "a.mat", arrays)
    return folder / "a.mat"


@pytest.mark.parametrize(
    "axes", ["what,where,trial,sample,taxel", "what,where,taxel,trial,sample", "where,what,sample,trial,taxel"]
)
def test_trials_of_each_object_and_position_may_differ_in_number(tmp_path, axes):
    names = ["what", "where", "trial", "sample", "taxel"]
    inside = [names.index(axis) - 2 for axis in axes.split(",")[2:]]
    data = cells(lambda *of: samples(*of).transpose(inside))
    data = data if axes.startswith("what") else data.T
    path = saved(tmp_path, data=data, objects=np.array([["object 0"], ["object 1"]], object), places=[0.0, 1.5, 3.0])
    how = TapMap(taps="data", axes=axes, what_names="objects", where_values="places")

    check(load_mapped(path, how).taps)


def test_labels_may_stand_in_cells_of_their_own_or_one_for_each_cell(tmp_path):
    path = saved(
        tmp_path,
        data=cells(samples),
        rep=cells(lambda *of: np.arange(float(of[2]))),
        at=1.5 * np.arange(3)[np.newaxis] + np.zeros((2, 1)),
        thing=cells(lambda *of: f"object {of[0]}"),
    )
    check(
        load_mapped(
            path, TapMap(taps="data", axes="tap,tap,tap,sample,taxel", what="thing", where="at", trial="rep")
        ).taps
    )


def test_structs_with_taps_each(tmp_path):
    """Of different lengths."""
    records = np.empty(3, dtype=[("x", object), ("thing", object)])
    for number, (trials, length) in enumerate([(2, 3), (1, 4), (3, 2)]):
        records[number] = np.full((trials, length, K), number), f"object {number}"
    taps = load_mapped(
        saved(tmp_path, s=records), TapMap(taps="s.x", axes="tap,trial,sample,taxel", what="s.thing", length="shortest")
    )

    assert taps.taps.taps[:, 0, 0].tolist() == [0, 0, 1, 2, 2, 2]
    assert taps.taps.taps.shape[1:] == (2, K)
    assert [taps.taps.what_name[m][-1] for m in taps.taps.what] == ["0", "0", "1", "2", "2", "2"]
    assert taps.taps.trial.tolist() == [0, 1, 0, 0, 1, 2]


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        (
            {"axes": "what,sample,trial,where,taxel"},
            "must begin with tap or a label for each of 2 axes of elements, got what, sample",
        ),
        ({"axes": "what,where,what,sample,taxel"}, r"axes \(--axes\) has what twice"),
        ({"keep": "rep>0"}, r"rep has elements of different shapes"),
        ({"trial": "rep"}, "rep has elements of different shapes, so it has no value for each tap"),
    ],
)
def test_axes_and_labels_that_do_not_fit(tmp_path, keys, message):
    path = saved(tmp_path, data=cells(samples), rep=cells(lambda *of: np.arange(4.0 - of[1])))
    with pytest.raises(InputError, match=message):
        load_mapped(path, TapMap(**({"taps": "data", "axes": "what,where,tap,sample,taxel"} | keys)))


def one(n):
    return np.zeros((J, K)) + n


def test_cells_inside_cells_may_differ_in_number(tmp_path):
    """data{object}{trial}, and a struct array exp.session(s).trial(i) with the label of each trial."""
    counts = (2, 3, 1)
    data, sessions = np.empty(3, object), np.empty(3, object)
    for m, count in enumerate(counts):
        data[m] = np.empty(count, object)
        for t in range(count):
            data[m][t] = one(10 * m + t)
        trials = [{"data": one(10 * m + t), "kind": f"kind {t}", "pos": 10.0 * m + t} for t in range(count)]
        sessions[m] = {"trial": np.array(trials, dtype=object)}
    path = saved(tmp_path, data=data, exp={"session": sessions, "names": np.array(["a", "b", "c"], object)})
    number = [10 * m + t for m, count in enumerate(counts) for t in range(count)]

    taps = load_mapped(path, TapMap(taps="data", axes="what,trial,sample,taxel", what_names="exp.names")).taps
    assert taps.taps[:, 0, 0].tolist() == number
    assert taps.what.tolist() == [n // 10 for n in number]
    assert taps.trial.tolist() == [n % 10 for n in number]

    trial = "exp.session.trial"
    how = TapMap(taps=f"{trial}.data", axes="session,trial,sample,taxel", what=f"{trial}.kind", where=f"{trial}.pos")
    taps = load_mapped(path, how).taps
    assert taps.taps[:, 0, 0].tolist() == taps.where.tolist() == number
    assert [taps.what_name[m] for m in taps.what] == [f"kind {n % 10}" for n in number]
    assert taps.session.tolist() == [n // 10 for n in number]


def test_taps_are_kept_by_values_in_cells_of_their_own_or_one_for_each_cell(tmp_path):
    path = saved(
        tmp_path,
        data=cells(samples),
        good=cells(lambda *of: np.arange(of[2]) != 1),
        each=np.array([[1, 0, 1], [0, 1, 0]]),
        places=[0.0, 1.5, 3.0],
    )
    how = TapMap(
        taps="data", axes="what,where,trial,sample,taxel", what_names=("object 0", "object 1"), where_values="places"
    )
    for keep, wanted_ones in (
        ("good", [of for of in wanted() if of[2] != 1]),
        (
            "each=1",
            [of for of in wanted() if (of[0], of[1]) in {("object 0", 0.0), ("object 0", 3.0), ("object 1", 1.5)}],
        ),
    ):
        taps = load_mapped(path, how.changed(keep=keep)).taps
        assert list(zip([taps.what_name[m] for m in taps.what], taps.where, taps.trial, strict=True)) == wanted_ones
