"""`convert` and `inspect` as a person types them."""

import numpy as np
import pyarrow as pa
import pytest
import typer
from pyarrow import parquet
from solidtouch.cli.convert import convert
from solidtouch.cli.inspect import inspect
from solidtouch.models.errors import InputError
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.taps import TapSet
from typer.testing import CliRunner

app = typer.Typer()
app.command()(convert)
app.command()(inspect)


def run(*words):
    result = CliRunner().invoke(app, [str(word) for word in words])
    if isinstance(result.exception, InputError):
        raise result.exception
    assert result.exit_code == 0, result.output
    return result.output


@pytest.fixture
def stream(tmp_path):
    """A CSV file with one stream of two presses on the second of two taxels, at 10 samples per second."""
    values = [0, 0, 0, 5, 5, 5, 0, 0, 0, 5, 5, 5, 0, 0]
    rows = "".join(f"{j / 10},ball,{j},100,{100 + value}\n" for j, value in enumerate(values))
    (tmp_path / "stream.csv").write_text("time_s,what,where,taxel_0,taxel_1\n" + rows)
    return tmp_path / "stream.csv"


CUT = (
    "--segment",
    "--trigger",
    "contact",
    "--level",
    3,
    "--window",
    4,
    "--pre",
    1,
    "--tare",
    "stream",
    "--tare-samples",
    2,
)


def test_streams_are_cut_and_labelled(stream, tmp_path):
    out = tmp_path / "taps.nc"
    text = run("convert", stream, out, *CUT, "--sensor", "tip", "--units", "counts", "--where-unit", "mm")
    taps = TapSet.load(out)

    assert "2 taps from 1 stream." in text
    assert taps.taps[:, :, 1].tolist() == [[0, 5, 5, 5]] * 2
    assert taps.preprocessing == Preprocessing(4, 10.0, "stream", 2, 0.0, "contact", 3.0, 1)
    assert (taps.where.tolist(), taps.where_unit, taps.dataset.attrs["sensor"]) == ([3.0, 9.0], "mm", "tip")
    assert taps.dataset["taps"].attrs["units"] == "counts"


def test_a_rate_given_goes_before_that_of_the_file(stream, tmp_path):
    run("convert", stream, tmp_path / "taps.nc", *CUT, "--rate", 40)

    assert TapSet.load(tmp_path / "taps.nc").preprocessing.rate_hz == 40.0


def test_several_files_become_sessions_of_one(make_taps, tmp_path):
    """As a set with these sessions; in their order, also where all call themselves session 0."""
    whole = make_taps(sessions=3)
    files = []
    for session in range(3):
        part = whole.select(whole.session == session)
        files.append(tmp_path / f"{session}.nc")
        TapSet(part.dataset.assign_coords(session=("tap", np.zeros(len(part), int)))).save(files[-1])
    text = run("convert", *files, tmp_path / "all.nc", "--sensor", "tip")
    taps = TapSet.load(tmp_path / "all.nc")

    assert f"{len(whole)} taps of" in text
    assert taps.taps.tolist() == np.concatenate([whole.taps[whole.session == s] for s in range(3)]).tolist()
    assert taps.session.tolist() == sorted(whole.session.tolist())
    assert taps.grid().where_value.tolist() == whole.grid().where_value.tolist()
    assert taps.dataset.attrs["sensor"] == "tip"


def test_files_of_other_places_have_the_places_of_all(make_taps, tmp_path):
    """Each with a table of its own."""
    whole = make_taps(sessions=2, L=3)
    where, _ = whole.indices(whole.grid())
    value = whole.grid().where_value
    for name, chosen, table in (
        ("a", (whole.session == 0) & (where > 0), value[1:]),
        ("b", (whole.session == 1) & (where < 2), value[:2]),
    ):
        part = whole.select(chosen).dataset.drop_vars(("where_value", "where_edges"), errors="ignore")
        column = ("where_class", table, whole.dataset["where_value"].attrs)
        TapSet(part.assign_coords(where_value=column)).save(tmp_path / f"{name}.nc")
    run("convert", tmp_path / "a.nc", tmp_path / "b.nc", tmp_path / "all.nc")
    taps = TapSet.load(tmp_path / "all.nc")

    assert TapSet.load(tmp_path / "a.nc").grid().where_value.tolist() == value[1:].tolist()
    assert taps.grid().where_value.tolist() == value.tolist()
    assert (taps.indices(taps.grid())[0] >= 0).all()
    assert taps.where_unit == whole.where_unit


def test_the_same_taps_twice_are_no_two_sessions(make_taps, tmp_path):
    make_taps(sessions=1).save(tmp_path / "a.nc")
    make_taps(sessions=2).save(tmp_path / "b.nc")
    with pytest.raises(InputError, match=r"b\.nc: 84 taps are also in .*a\.nc"):
        run("convert", tmp_path / "a.nc", tmp_path / "b.nc", tmp_path / "all.nc")
    assert not (tmp_path / "all.nc").exists()


def test_tap_sets_can_be_relabelled_in_place(make_taps, tmp_path):
    make_taps().save(tmp_path / "a.nc")
    run("convert", tmp_path / "a.nc", tmp_path / "a.nc", "--force", "--licence", "MIT")

    assert TapSet.load(tmp_path / "a.nc").dataset.attrs["licence"] == "MIT"


def test_what_is_left_out_is_said(tmp_path):
    np.savez(tmp_path / "a.npz", taps=np.zeros((3, 2, 4)), what=[0, 0, 0], what_names=["a"], camera=np.zeros((3, 9)))

    printed = run("convert", tmp_path / "a.npz", tmp_path / "a.nc")
    assert "Array camera is left out: not one row per tap, (3, 9)." in printed


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--window", 4), r"window \(--window\) 4 requires trigger \(--trigger\), such as contact"),
        (("--tare", "none"), r"tare \(--tare\) none requires trigger \(--trigger\)"),
        (("--segment", "--trigger", "clock"), r"trigger \(--trigger\) clock requires window \(--window\)"),
        (("--segment", "--window", 4), r"--segment requires trigger \(--trigger\)"),
        (("--segment", "--window", 4, "--trigger", "contact"), r"contact requires level \(--level\)"),
        (("--segment", "--window", 4, "--trigger", "contact", "--level", 0), r"contact requires level \(--level\)"),
        (
            ("--segment", "--window", 4, "--trigger", "clock", "--level", 2),
            r"level \(--level\) 2.0 requires trigger \(--trigger\) or align",
        ),
        (
            (*CUT, "--level", 300),
            r"stream\.csv: trigger \(--trigger\) contact: no tap found in 1 stream: the level \(--level\) is 300",
        ),
        ((*CUT, "--rate", 0), "--rate must be a positive number or none, got 0"),
        ((), "cut them into taps with solidtouch convert --trigger"),
        ((*CUT, "--what-unit", "mm"), r"\(--what-unit\) was given"),
    ],
)
def test_options_that_do_not_go_together_write_nothing(options, message, stream, tmp_path):
    with pytest.raises(InputError, match=message):
        run("convert", stream, tmp_path / "taps.nc", *options)

    assert [path.name for path in tmp_path.iterdir()] == ["stream.csv"]


def test_the_output_is_checked_before_the_input_is_read(tmp_path):
    (tmp_path / "old.nc").write_text("precious")
    for out, message in (
        ("old.nc", r"already exists; use --force to overwrite it"),
        ("taps.npz", "must end in .nc"),
        ("no/taps.nc", "no folder"),
    ):
        with pytest.raises(InputError, match=message):
            run("convert", tmp_path / "none.npz", tmp_path / out)

    with pytest.raises(InputError, match="no such file"):
        run("convert", tmp_path / "none.npz", tmp_path / "old.nc", "--force")
    assert (tmp_path / "old.nc").read_text() == "precious"


def test_any_kind_is_inspected_in_cells(make_taps, tmp_path):
    make_taps().save(tmp_path / "a.nc")
    text = run("inspect", tmp_path / "a.nc", "--where-cell", "3mm", "--what-cell", "4mm")

    assert "21+21" not in text
    assert "28+28" in text
    with pytest.raises(InputError, match="cannot be converted"):
        run("inspect", tmp_path / "a.nc", "--where-cell", "3kg")


def test_missing_samples_of_a_map_are_kept_where_they_may_be(tmp_path):
    (tmp_path / "a.csv").write_text("press;f1;f2\n1;0.5;\n1;1;2\n2;3;4\n2;5;6\n")
    options = ("--taxels", "f*", "--tap", "press")
    with pytest.raises(InputError, match="--missing drop"):
        run("convert", tmp_path / "a.csv", tmp_path / "a.nc", *options)
    run("convert", tmp_path / "a.csv", tmp_path / "a.nc", *options, "--missing", "drop")

    assert TapSet.load(tmp_path / "a.nc", "drop").lacking.tolist() == [[0, 1], [0, 0]]


def test_a_recording_of_another_layout_is_told_how_to_go_on(tmp_path):
    (tmp_path / "a.csv").write_text("press;f1;f2\n1;0.5;3\n")
    with pytest.raises(InputError, match=r"missing column what.*solidtouch convert --look shows what is there\.$"):
        run("convert", tmp_path / "a.csv", tmp_path / "a.nc")


def test_a_table_of_parquet_is_told_how_to_go_on(tmp_path):
    table = {"tap": [0, 0, 1, 1], "what": ["a", "a", "b", "b"], "taxel_0": [1.0, 2, 3, 5]}
    parquet.write_table(pa.table(table), tmp_path / "a.parquet")
    with pytest.raises(InputError, match=r"\.parquet files are read .* with --map .* begin with\.$"):
        run("convert", tmp_path / "a.parquet", tmp_path / "a.nc")
    run("convert", tmp_path / "a.parquet", tmp_path / "a.nc", "--tap", "tap", "--taxels", "taxel*", "--what", "what")

    assert TapSet.load(tmp_path / "a.nc").what_name == ["a", "b"]


def test_looking_at_times_tells_gaps_and_at_x_and_y_a_plane(tmp_path):
    rows = [
        (press, x, y, 10 * press + j / 10) for press, (x, y) in enumerate([(0, 0), (0, 1), (2, 0)]) for j in range(9)
    ]
    lines = [f"{press},{x},{y},{t},{x + j},{y - j}" for j, (press, x, y, t) in enumerate(rows)]
    (tmp_path / "a.csv").write_text("\n".join(["press,x [mm],y [mm],t [s],f1,f2", *lines]))
    text = run("convert", "--look", tmp_path / "a.csv")

    assert 'time = "t [s]"  # it increases by 0.1, with 2 gaps' in text
    assert 'where = ["x [mm]", "y [mm]"]' in text
    assert "3 taps, 9 samples x 2 taxels, 1 object, 3 positions, 1 session" in text


def test_taps_of_this_layout_are_resampled_and_freed_of_dead_taxels(tmp_path):
    taps = np.random.default_rng(3).normal(size=(4, 20, 3))
    taps[:, :, 1] = 7.0
    np.savez(tmp_path / "a.npz", taps=taps, what=[0, 0, 1, 1], what_names=["a", "b"])
    printed = run(
        "convert", tmp_path / "a.npz", tmp_path / "a.nc", "--rate", 100, "--resample", 50, "--leave-out", "dead"
    )
    found = TapSet.load(tmp_path / "a.nc")

    assert "1 of 3 taxels left out: 1 (dead: one value throughout)." in printed
    assert found.taps.shape == (4, 10, 2)
    assert (found.preprocessing.sensor_hz, found.preprocessing.rate_hz) == (100, 50)
    assert found.preprocessing.taxels == (0, 2)


def test_a_tap_set_is_freed_of_dead_taxels_but_not_resampled(make_taps, tmp_path):
    whole = make_taps()
    data = whole.taps.copy()
    data[:, :, 0] = 7.0
    TapSet(whole.dataset.assign(taps=(whole.dataset["taps"].dims, data))).save(tmp_path / "a.nc")
    run("convert", tmp_path / "a.nc", tmp_path / "b.nc", "--leave-out", "dead")

    assert TapSet.load(tmp_path / "b.nc").taps.tolist() == data[:, :, 1:].tolist()
    with pytest.raises(InputError, match=r"a\.nc: resample \(--resample\) is for frames"):
        run("convert", tmp_path / "a.nc", tmp_path / "c.nc", "--resample", 50)


@pytest.mark.parametrize(
    "words", [["both"], ["dead,saturated"], ["dead", "--leave-out", "saturated"], ["saturated", "--leave-out", "dead"]]
)
def test_kinds_of_taxels_may_be_listed_or_given_one_after_the_other(tmp_path, words):
    taps = np.random.default_rng(3).normal(size=(4, 20, 3))
    taps[:, :, 1] = 7.0
    taps[:, 5:15, 2] = 9.0
    np.save(tmp_path / "a.npy", taps)
    run("convert", tmp_path / "a.npy", tmp_path / "a.nc", "--axes", "tap,sample,taxel", "--leave-out", *words)

    assert TapSet.load(tmp_path / "a.nc").preprocessing.taxels == (0,)


def test_names_and_positions_may_be_listed_or_given_one_after_the_other(tmp_path):
    np.save(tmp_path / "a.npy", np.arange(16.0).reshape(2, 2, 2, 2))
    names, places = ("--what-names", "a", "--what-names", "b"), ("--where-values", 1.5, "--where-values", 2.5)
    run("convert", tmp_path / "a.npy", tmp_path / "a.nc", "--axes", "what,where,sample,taxel", *names, *places)
    taps = TapSet.load(tmp_path / "a.nc")

    assert taps.what_name == ["a", "b"]
    assert taps.where.tolist() == [1.5, 2.5, 1.5, 2.5]


def test_a_log_with_an_arrow_after_the_time_is_converted(tmp_path):
    rows = "\n".join(f"14:02:11.{100 + 25 * n} -> {n},{-n}" for n in range(6))
    (tmp_path / "a.log.txt").write_text(rows)
    words = "--no-header", "--tap", "file", "--time", 0
    for more in ([], ["--delimiter", "->", "--delimiter", ","]):
        run("convert", tmp_path / "a.log.txt", tmp_path / "a.nc", "--taxels", "1:", *words, *more, "--force")
        taps = TapSet.load(tmp_path / "a.nc")

        assert taps.taps.tolist() == [[[n, -n] for n in range(6)]]
        assert taps.preprocessing.rate_hz == 40


def test_one_slice_of_taxels_and_one_pattern_of_columns_need_no_list(tmp_path):
    np.save(tmp_path / "a.npy", np.arange(12.0).reshape(1, 3, 4))
    run("convert", tmp_path / "a.npy", tmp_path / "a.nc", "--axes", "tap,sample,taxel", "--taxels", "1:3")
    (tmp_path / "b.csv").write_text("v0,v1\n1,2\n3,4\n")
    run("convert", tmp_path / "b.csv", tmp_path / "b.nc", "--taxels", "v{sample}")

    assert TapSet.load(tmp_path / "a.nc").taps.tolist() == [[[1, 2], [5, 6], [9, 10]]]
    assert TapSet.load(tmp_path / "b.nc").taps.tolist() == [[[1], [2]], [[3], [4]]]
