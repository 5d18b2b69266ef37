"""Any recording, written in any layout by a random map, is read back equal."""

import h5py
import numpy as np
import pandas as pd
import scipy.io
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from solidtouch.models.io.layouts.mapping import TapMap
from solidtouch.models.io.layouts.tap_set import load_mapped

NAMES = ("cup", "rod 4 mm", "Bälle", "x-1")
AXES = ("what", "where", "trial", "sample", "taxel")


@st.composite
def recordings(draw):
    """Samples over (what, where, session, trial, sample, taxel), in quarters, with names and positions."""
    shape = [draw(st.integers(1, 3)) for _ in range(4)] + [draw(st.integers(1, 4)), draw(st.integers(1, 3))]
    seed = draw(st.integers(0, 2**32 - 1))
    samples = np.random.default_rng(seed).integers(-99, 99, shape) / 4
    places = sorted(draw(st.sets(st.integers(-20, 20), min_size=shape[1], max_size=shape[1])))
    return samples, NAMES[: shape[0]], np.array(places) / 2


def wanted(recording):
    samples, names, places = recording
    return {(names[m], places[l], s, t): samples[m, l, s, t].tolist() for m, l, s, t in np.ndindex(samples.shape[:4])}


def found(sources, how):
    taps = load_mapped(sources, how).taps
    keys = zip(taps.what.tolist(), taps.where.tolist(), taps.session.tolist(), taps.trial.tolist(), strict=True)
    return {(taps.what_name[m], x, s, t): tap for (m, x, s, t), tap in zip(keys, taps.taps.tolist(), strict=True)}


ANY = settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def rows(recording, order):
    """One row for each sample, taps in a given order."""
    samples, names, places = recording
    parts = []
    for n, tap in enumerate(order):
        m, l, s, t = np.unravel_index(tap, samples.shape[:4])
        frame = pd.DataFrame(samples[m, l, s, t], columns=[f"Force {k} [N]" for k in range(samples.shape[-1])])
        parts.append(frame.assign(press=n, thing=names[m], at=places[l], day=s, rep=t))
    return pd.concat(parts, ignore_index=True)


@ANY
@given(recording=recordings(), data=st.data())
def test_one_table(recording, data, tmp_path):
    """Of text or JSON lines, with taps in any order, columns in any order, any delimiter and decimal mark."""
    N = int(np.prod(recording[0].shape[:4]))
    frame = rows(recording, data.draw(st.permutations(range(N))))
    taxels = [name for name in frame if name.startswith("Force")]
    others = data.draw(st.permutations([name for name in frame if name not in taxels]))
    frame = frame[[*others[:2], *taxels, *others[2:]]]
    how = TapMap(taxels="Force*", tap="press", what="thing", where="at", session="day", trial="rep")
    kind = data.draw(st.sampled_from(["csv", "txt", "jsonl"]))
    path = tmp_path / f"recording.{kind}"
    if kind == "jsonl":
        frame.to_json(path, orient="records", lines=True)
    else:
        delimiter, decimal = data.draw(st.sampled_from([(",", "."), (";", ","), ("\t", ","), ("|", ".")]))
        frame.to_csv(
            path,
            sep=delimiter,
            decimal=decimal,
            index=False,
            encoding=data.draw(st.sampled_from(["utf-8", "utf-8-sig"])),
        )
        how = how.changed(decimal=decimal)

    assert found([path], how) == wanted(recording)


@ANY
@given(recording=recordings(), data=st.data())
def test_one_array(recording, data, tmp_path):
    """With its axes in any order, in `.npy`, `.npz` or `.mat`, one file for each session."""
    samples, names, places = recording
    order = data.draw(st.permutations(range(5)))
    kind = data.draw(st.sampled_from(["npy", "npz", "mat"]))
    paths = []
    for session in range(samples.shape[2]):
        array = samples[:, :, session].transpose(order)
        paths.append(tmp_path / f"{session}.{kind}")
        if kind == "npy":
            np.save(paths[-1], array)
        elif kind == "npz":
            np.savez(paths[-1], array)
        else:
            scipy.io.savemat(paths[-1], {"data": array})
    axes = [AXES[i] for i in order]
    if kind == "mat":  # MATLAB has no axes of length 1 at the end, and one of no other length is a vector
        while len(axes) > 2 and array.shape[len(axes) - 1] == 1:
            axes.pop()
    how = TapMap(axes=",".join(axes), what_names=names, where_values=tuple(places.tolist()))
    expected = {(w, x, s, t): tap for (w, x, s, t), tap in wanted(recording).items()}
    if kind == "mat" and (len(axes) < 5 or samples.size == max(samples.shape)):
        return  # what MATLAB keeps is another array
    got = found(paths, how)
    assert got == expected


@ANY
@given(recording=recordings(), data=st.data())
def test_one_file_for_each_tap(recording, data, tmp_path_factory):
    """With labels in the names of folders and files, in any of several arrangements."""
    samples, names, places = recording
    folder = tmp_path_factory.mktemp("taps")
    layout = data.draw(
        st.sampled_from(
            [
                "{what}/{session}/at{where}_{trial}.csv",
                "day{session}/{what}_{where}mm_{trial}.csv",
                "s{session}/t{trial}/{where}/{what}.csv",
            ]
        )
    )
    K = samples.shape[-1]
    for m, l, s, t in np.ndindex(samples.shape[:4]):
        path = folder / layout.format(what=names[m], where=places[l], session=s, trial=t)
        path.parent.mkdir(parents=True, exist_ok=True)
        pd.DataFrame(samples[m, l, s, t], columns=[f"s{k}" for k in range(K)]).to_csv(path, index=False)

    assert found([folder], TapMap(files=layout, taxels="s*", tap="file")) == wanted(recording)


def flat(recording, order):
    """Samples of taps in a given order, and a table of their labels."""
    samples, names, places = recording
    m, l, s, t = np.unravel_index(list(order), samples.shape[:4])
    labels = pd.DataFrame({"thing": np.array(names)[m], "at": places[l], "day": s, "rep": t})
    return samples[m, l, s, t], labels


@ANY
@given(recording=recordings(), data=st.data())
def test_groups_and_structs(recording, data, tmp_path):
    """A group of HDF5 for each session, or a struct of MATLAB, with taps in any order."""
    samples, labels = flat(recording, data.draw(st.permutations(range(int(np.prod(recording[0].shape[:4]))))))
    if data.draw(st.booleans()) or min(samples.shape) == 1:  # of MATLAB a vector or a single struct
        path, before = tmp_path / "recording.h5", "day_{session}/"
        with h5py.File(path, "w") as file:
            for day, of in labels.groupby("day"):
                group = file.create_group(f"day_{day}")
                group["taps"], group["at"], group["rep"] = samples[of.index], of["at"], of["rep"]
                group["thing"] = [name.encode() for name in of["thing"]]
        how = TapMap(taps=f"{before}taps", axes="tap,sample,taxel")
    else:
        path, before = tmp_path / "recording.mat", "data."
        cells = np.empty((1, len(samples)), [(key, object) for key in ("taps", "thing", "at", "day", "rep")])
        for n, (tap, row) in enumerate(zip(samples, labels.itertuples(), strict=True)):
            cells[0, n] = (tap, row.thing, row.at, row.day, row.rep)
        scipy.io.savemat(path, {"data": cells})
        how = TapMap(taps="data.taps", session="data.day")
    how = how.changed(what=f"{before}thing", where=f"{before}at", trial=f"{before}rep")

    assert found([path], how) == wanted(recording)


@ANY
@given(recording=recordings(), data=st.data())
def test_long_tables(recording, data, tmp_path):
    """A row for each sample of each taxel, taxel by taxel in each tap or sample by sample."""
    samples, labels = flat(recording, data.draw(st.permutations(range(int(np.prod(recording[0].shape[:4]))))))
    n, j, k = np.indices(samples.shape)
    order = (k, j, n) if data.draw(st.booleans()) else (j, k, n)
    at = np.lexsort([axis.reshape(-1) for axis in order])
    table = labels.iloc[n.reshape(-1)[at]].assign(press=n.reshape(-1)[at], t=j.reshape(-1)[at] / 10)
    table = table.assign(pad=[f"pad {each}" for each in k.reshape(-1)[at]], value=samples.reshape(-1)[at])
    table.to_csv(tmp_path / "long.csv", index=False)
    how = TapMap(taxels="value", taxel="pad", tap="press", time="t")
    how = how.changed(what="thing", where="at", session="day", trial="rep")

    assert found([tmp_path / "long.csv"], how) == wanted(recording)


@ANY
@given(recording=recordings(), data=st.data())
def test_lists_in_cells(recording, data, tmp_path):
    """Of Parquet or JSON lines; some taps go on for longer, and are cut to the length of the others."""
    samples, labels = flat(recording, data.draw(st.permutations(range(int(np.prod(recording[0].shape[:4]))))))
    J, K = samples.shape[1:]
    longer = data.draw(st.lists(st.integers(0, 2), min_size=len(samples), max_size=len(samples)))
    labels["signal"] = [[*tap.tolist(), *[[9.0] * K] * more] for tap, more in zip(samples, longer, strict=True)]
    path = tmp_path / data.draw(st.sampled_from(["r.parquet", "r.jsonl", "r.feather"]))
    if path.suffix == ".jsonl":
        labels.to_json(path, orient="records", lines=True)
    else:
        (labels.to_parquet if path.suffix == ".parquet" else labels.to_feather)(path)
    how = TapMap(taps="signal", length=J, what="thing", where="at", session="day", trial="rep")

    assert found([path], how) == wanted(recording)


@ANY
@given(recording=recordings(), data=st.data())
def test_a_shuffled_table_of_labels(recording, data, tmp_path_factory):
    """One file for each tap and a table that lists them in another order, with others that are not there."""
    folder = tmp_path_factory.mktemp("taps")
    samples, labels = flat(recording, range(int(np.prod(recording[0].shape[:4]))))
    labels["name"] = [f"p{n}{data.draw(st.sampled_from(['', '.csv']))}" for n in range(len(samples))]
    for n, tap in enumerate(samples):
        pd.DataFrame(tap, columns=[f"s{k}" for k in range(tap.shape[1])]).to_csv(folder / f"p{n}.csv", index=False)
    labels.loc[len(labels)] = ["gone", 3.0, 0, 0, "999.csv"]
    order = data.draw(st.permutations(range(len(labels))))
    columns = data.draw(st.permutations(list(labels)))
    labels.iloc[order][columns].to_csv(folder / "labels.csv", index=False)
    keys = {"what": "thing", "where": "at", "session": "day", "trial": "rep"}
    how = TapMap(taxels="s*", tap="file", **{key: f"labels.csv:{column}" for key, column in keys.items()})

    assert found([folder], how) == wanted(recording)


@ANY
@given(recording=recordings(), data=st.data())
def test_counters_that_restart(recording, data, tmp_path):
    """Rows that count anew within each tap, with rows between taps that are not kept."""
    samples, labels = flat(recording, data.draw(st.permutations(range(int(np.prod(recording[0].shape[:4]))))))
    parts = []
    for tap, row in zip(samples, labels.to_dict("records"), strict=True):
        before, after = data.draw(st.tuples(st.integers(0, 2), st.integers(0, 2)))
        count = before + len(tap) + after
        frame = pd.DataFrame(np.pad(tap, ((before, after), (0, 0))), columns=[f"s{k}" for k in range(tap.shape[1])])
        kept = np.arange(count)
        parts.append(frame.assign(**row, count=kept + 1, on=(kept >= before) & (kept < before + len(tap))))
    pd.concat(parts).astype({"on": int}).to_csv(tmp_path / "r.csv", index=False)
    how = TapMap(taxels="s*", tap="restart:count", keep="on", what="thing", where="at", session="day", trial="rep")

    assert found([tmp_path / "r.csv"], how) == wanted(recording)
