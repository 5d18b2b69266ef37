"""Twelve layouts of recordings as people publish them, converted by `solidtouch convert` alone."""

import json
from itertools import product
from typing import NamedTuple

import h5py
import numpy as np
import pandas as pd
import pytest
import scipy.io
import typer
from mcap.writer import Writer
from slow_cases import slow_but
from solidtouch.cli.convert import convert
from solidtouch.models.errors import InputError
from solidtouch.models.io.layouts.mapping import load_map
from solidtouch.models.taps import TapSet
from typer.testing import CliRunner

OBJECTS, PLACES, TRIALS, SESSIONS, J, K = ("cup", "rod", "ball"), (0.0, 2.5, 5.0), 2, 2, 4, 3


class Press(NamedTuple):
    """One tap of the recording that every layout holds."""

    what: str
    where: float
    session: int
    trial: int
    samples: np.ndarray


@pytest.fixture(scope="module")
def presses():
    """All objects at all places, twice in each of two sessions; quarters, which every format keeps."""
    numbers = np.random.default_rng(3).integers(-400, 400, (3, 3, SESSIONS, TRIALS, J, K)) / 4
    cells = product(range(SESSIONS), range(len(OBJECTS)), range(len(PLACES)), range(TRIALS))
    return [Press(OBJECTS[m], PLACES[l], s, t, numbers[m, l, s, t]) for s, m, l, t in cells]


def stacked(presses):
    """Samples and labels as arrays."""
    return (
        np.stack([press.samples for press in presses]),
        np.array([OBJECTS.index(press.what) for press in presses]),
        np.array([PLACES.index(press.where) for press in presses]),
        np.array([press.session for press in presses]),
        np.array([press.trial for press in presses]),
    )


def converted(folder, *words):
    """Taps that the command writes, by object, position, session and trial."""
    app = typer.Typer()
    app.command()(convert)
    result = CliRunner().invoke(app, [*map(str, words[:-1]), str(folder / "taps.nc"), *words[-1]])
    if isinstance(result.exception, InputError):
        raise result.exception
    assert result.exit_code == 0, result.output
    return TapSet.load(folder / "taps.nc")


def by_label(taps):
    keys = zip(taps.what.tolist(), taps.where.tolist(), taps.session.tolist(), taps.trial.tolist(), strict=True)
    return {
        (taps.what_name[m], where, s, t): tap for (m, where, s, t), tap in zip(keys, taps.taps.tolist(), strict=True)
    }


def check(taps, presses):
    """Whether these are all presses, with their labels and samples."""
    wanted = {(p.what, p.where, p.session, p.trial): p.samples.tolist() for p in presses}
    assert by_label(taps) == wanted
    assert len(taps) == len(presses)


def test_semicolons_and_decimal_commas_with_units_in_the_header(presses, tmp_path):
    lines = ["Zeit [ms];Objekt;Position [mm];Tag;Versuch;Kraft 1 [N];Kraft 2 [N];Kraft 3 [N]"]
    for n, press in enumerate(presses):
        for j, row in enumerate(press.samples):
            cells = [n * 100 + 10 * j, press.what, press.where, press.session, press.trial, *row]
            lines.append(";".join(str(cell).replace(".", ",") for cell in cells))
    (tmp_path / "messung.csv").write_text("\n".join(lines) + "\n", encoding="latin-1")
    options = "--decimal , --what Objekt --where Position --session Tag --trial Versuch --tap Versuch --time Zeit"
    taps = converted(tmp_path, tmp_path / "messung.csv", [*options.split(), "--taxels", "Kraft*"])

    check(taps, presses)
    assert (taps.where_unit, taps.dataset["taps"].attrs["units"]) == ("mm", "N")
    assert taps.preprocessing.rate_hz == 100


def test_one_csv_file_per_press_in_folders_named_by_object(presses, tmp_path):
    for press in presses:
        folder = tmp_path / "data" / f"day{press.session + 1}" / press.what
        folder.mkdir(parents=True, exist_ok=True)
        rows = [f"{j / 50},{','.join(map(str, row))}" for j, row in enumerate(press.samples)]
        text = "\n".join(["t,Signal1,Signal2,Signal3", *rows])
        (folder / f"{press.what}_{press.where}mm_{press.trial}.csv").write_text(text)
    pattern = "folder:{session}/{what}/{what}_{where}_{trial}.csv"
    taps = converted(
        tmp_path, tmp_path / "data", ["--what", pattern, "--taxels", "Signal*", "--tap", "file", "--time", "t"]
    )

    assert sorted(set(taps.session.tolist())) == [0, 1]
    check(taps, presses)
    assert (taps.where_unit, taps.preprocessing.rate_hz) == ("mm", 50)


def test_an_array_with_axes_for_labels_and_names_beside_it(presses, tmp_path):
    samples = np.stack([press.samples for press in presses]).reshape(SESSIONS, 3, 3, TRIALS, J, K)
    np.save(tmp_path / "taps.npy", samples.transpose(1, 2, 0, 3, 4, 5))
    options = ["--axes", "what,where,session,trial,sample,taxel"]
    options += ["--what-names", ",".join(OBJECTS), "--where-values", "0,2.5,5"]
    check(converted(tmp_path, tmp_path / "taps.npy", options), presses)


def test_an_array_with_a_table_of_labels(presses, tmp_path):
    np.save(tmp_path / "taps.npy", stacked(presses)[0].transpose(2, 0, 1))
    rows = [f"{p.what},{p.where},{p.session},{p.trial}" for p in presses]
    (tmp_path / "labels.csv").write_text("\n".join(["material,where,session,trial", *rows]))
    options = ["--axes", "taxel,tap,sample", "--what", "labels.csv:material"]
    for key in ("where", "session", "trial"):
        options += [f"--{key}", "labels.csv"]
    check(converted(tmp_path, tmp_path / "taps.npy", options), presses)


def test_a_struct_array_of_matlab(presses, tmp_path):
    kind = [("signal", object), ("object", object), ("pos", object), ("day", object), ("rep", object)]
    data = np.empty((1, len(presses)), dtype=kind)
    for n, press in enumerate(presses):
        data[0, n] = (press.samples, press.what, press.where, press.session, press.trial)
    scipy.io.savemat(tmp_path / "rec.mat", {"data": data})
    options = "--taps data.signal --what data.object --where data.pos --session data.day --trial data.rep"
    check(converted(tmp_path, tmp_path / "rec.mat", options.split()), presses)


def test_matlab_7_3_with_references(presses, tmp_path):
    """Cells of samples and of names, as MATLAB writes them: axes reversed, texts as UTF-16."""
    _, what, where, session, trial = stacked(presses)
    with h5py.File(tmp_path / "rec.mat", "w", userblock_size=512) as file:
        refs = file.create_group("#refs#")
        signals, names = [], []
        for n, press in enumerate(presses):
            one = refs.create_dataset(f"s{n}", data=press.samples.T)
            one.attrs["MATLAB_class"] = np.bytes_("double")
            signals.append(one.ref)
        for n, name in enumerate(OBJECTS):
            one = refs.create_dataset(f"n{n}", data=np.array([[ord(letter)] for letter in name], dtype=np.uint16))
            one.attrs["MATLAB_class"], one.attrs["MATLAB_int_decode"] = np.bytes_("char"), 2
            names.append(one.ref)
        for name, cells in (("signals", signals), ("names", names)):
            cell = file.create_dataset(name, data=np.array([cells], dtype=h5py.ref_dtype))
            cell.attrs["MATLAB_class"] = np.bytes_("cell")
        for name, values in (("object", what + 1), ("pos", np.array(PLACES)[where]), ("day", session), ("rep", trial)):
            one = file.create_dataset(name, data=np.array([values], dtype=np.float64))
            one.attrs["MATLAB_class"] = np.bytes_("double")
    with (tmp_path / "rec.mat").open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    options = "--taps signals --what object --what-names names --one-based --where pos --session day --trial rep"
    check(converted(tmp_path, tmp_path / "rec.mat", options.split()), presses)


def test_matlab_5_with_indices_from_one(presses, tmp_path):
    samples, what, where, session, trial = stacked(presses)
    names = np.array(OBJECTS, dtype=object)
    arrays = {"X": samples.transpose(1, 2, 0), "y": what + 1, "p": where + 1, "day": session, "rep": trial}
    scipy.io.savemat(tmp_path / "rec.mat", arrays | {"classes": names, "positions": PLACES})
    options = "--taps X --axes sample,taxel,tap --what y --what-names classes --where p "
    options += "--where-values positions --one-based --session day --trial rep"
    check(
        converted(
            tmp_path, tmp_path / "rec.mat", [*options.split(), *["--one-based", "--session", "day", "--trial", "rep"]]
        ),
        presses,
    )


def test_parquet_with_lists(presses, tmp_path):
    frame = pd.DataFrame(
        {
            "signal": [press.samples.tolist() for press in presses],
            "object": [press.what for press in presses],
            "pos": [press.where for press in presses],
            "day": [press.session for press in presses],
            "rep": [press.trial for press in presses],
        }
    )
    frame.to_parquet(tmp_path / "rec.parquet")
    options = "--taps signal --what object --where pos --session day --trial rep"
    check(converted(tmp_path, tmp_path / "rec.parquet", options.split()), presses)


def test_hdf5_with_a_group_for_each_session(presses, tmp_path):
    with h5py.File(tmp_path / "rec.h5", "w") as file:
        for session in range(SESSIONS):
            of = [press for press in presses if press.session == session]
            samples, what, where, _, trial = stacked(of)
            group = file.create_group(f"session_{session}")
            group["taps"] = samples
            group["taps"].attrs["units"] = "counts"
            group["label"] = [OBJECTS[m].encode() for m in what]
            group["position"], group["trial"] = np.array(PLACES)[where], trial
    options = "--taps session_{session}/taps --what session_{session}/label --where session_{session}/position"
    taps = converted(tmp_path, tmp_path / "rec.h5", [*options.split(), "--trial", "session_{session}/trial"])

    check(taps, presses)
    assert taps.dataset["taps"].attrs["units"] == "counts"


def test_text_with_blanks_and_comments(presses, tmp_path):
    folder = tmp_path / "txt"
    folder.mkdir()
    for press in presses:
        rows = ["  ".join(f"{value:8.2f}" for value in row) for row in press.samples]
        text = "\n".join(["% recorded by hand", "%", *rows, ""])
        (folder / f"{press.what}-p{press.where}-s{press.session}-t{press.trial}.txt").write_text(text)
    pattern = "file:{what}-{where}-s{session}-t{trial}.txt"
    options = [
        "--what",
        pattern,
        "--delimiter",
        "blank",
        "--comment",
        "%",
        "--no-header",
        "--taxels",
        ":",
        "--tap",
        "file",
    ]
    check(converted(tmp_path, folder, options), presses)


def test_an_npz_without_names(presses, tmp_path):
    samples, what, where, session, trial = stacked(presses)
    np.savez(tmp_path / "rec.npz", samples, what, where, session, trial)
    options = "--taps arr_0 --what arr_1 --where arr_2 --session arr_3 --trial arr_4 --what-names cup,rod,ball"
    check(converted(tmp_path, tmp_path / "rec.npz", [*options.split(), "--where-values", "0,2.5,5"]), presses)


def test_json_lines(presses, tmp_path):
    with (tmp_path / "rec.jsonl").open("w") as file:
        for press in presses:
            label = {"object": press.what, "pos": f"{press.where} mm"}
            line = {"label": label, "day": press.session, "rep": press.trial, "signal": press.samples.tolist()}
            file.write(json.dumps(line) + "\n")
    options = "--taps signal --what label.object --where label.pos --session day --trial rep"
    taps = converted(tmp_path, tmp_path / "rec.jsonl", options.split())

    check(taps, presses)
    assert taps.where_unit == "mm"


def test_mcap(presses, tmp_path):
    """One file for each press, every message a frame."""
    folder = tmp_path / "bags"
    folder.mkdir()
    for press in presses:
        with (folder / f"{press.session}_{press.what}_{press.where}_{press.trial}.mcap").open("wb") as file:
            writer = Writer(file)
            writer.start()
            schema = writer.register_schema("Skin", "jsonschema", b'{"type": "object"}')
            channel = writer.register_channel("/skin", "json", schema)
            for j, row in enumerate(press.samples):
                stamp = 10**9 + j * 20_000_000
                writer.add_message(channel, stamp, json.dumps({"values": row.tolist()}).encode(), stamp)
            writer.finish()
    options = ["--taps", "/skin/values", "--tap", "file", "--time", "/skin/log_time"]
    options += ["--what", "file:{session}_{what}_{where}_{trial}.mcap"]
    taps = converted(tmp_path, folder, options)

    check(taps, presses)
    assert taps.preprocessing.rate_hz == 50


class WrittenError(Exception):
    """A layout is written; its options are not needed."""


LAYOUTS = {name.removeprefix("test_"): value for name, value in sorted(globals().items()) if name.startswith("test_")}
TOLD = {
    "semicolons_and_decimal_commas_with_units_in_the_header": ["--decimal", ","],
    "text_with_blanks_and_comments": ["--delimiter", "blank", "--comment", "%", "--no-header"],
}
"""What a user has to say, of layouts that do not tell."""
UNCLEAR = {
    "an_array_with_axes_for_labels_and_names_beside_it",
    "an_array_with_a_table_of_labels",
    "an_npz_without_names",
}
"""Layouts without names of what is in them."""


DIFFERENT = [
    "an_npz_without_names",
    "hdf5_with_a_group_for_each_session",
    "json_lines",
    "matlab_7_3_with_references",
    "one_csv_file_per_press_in_folders_named_by_object",
    "semicolons_and_decimal_commas_with_units_in_the_header",
]


@pytest.mark.parametrize("name", slow_but(DIFFERENT, LAYOUTS))
def test_look_prints_a_map_that_is_read_and_mostly_right(name, presses, tmp_path, monkeypatch):
    """It is right but for layouts that name nothing."""

    def written(_, *words):
        raise WrittenError(words[0])

    monkeypatch.setitem(globals(), "converted", written)
    with pytest.raises(WrittenError) as told:
        LAYOUTS[name](presses, tmp_path)
    monkeypatch.undo()
    source, app = told.value.args[0], typer.Typer()
    app.command()(convert)
    result = CliRunner().invoke(app, ["--look", *TOLD.get(name, []), str(source)])
    assert result.exit_code == 0, result.output
    (tmp_path / "map.toml").write_text(result.stdout)
    load_map(tmp_path / "map.toml")
    if name not in UNCLEAR:
        assert "\n# With this map: 36 taps, 4 samples x 3 taxels, 3 objects, 3 positions, 2 sessions." in result.stdout
        check(converted(tmp_path, source, ["--map", str(tmp_path / "map.toml")]), presses)
