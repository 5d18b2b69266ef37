"""`solidtouch redraw` draws what the run drew, from its file of numbers alone."""

from functools import cache
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr
from solidtouch.analysis.experiment.crosscheck import CrossCheck, RouteDifference
from solidtouch.analysis.page.figure_style import drawing_of
from solidtouch.models.storage import write_netcdf

import solidtouch as st

DOCUMENT = Path(__file__).parents[2] / "docs" / "reference" / "numbers.md"
ENDS = ("_low", "_high")


@pytest.fixture(scope="module")
def comparison(make_taps):
    taps = make_taps()
    parts = [taps.select(taps.session == session) for session in (0, 1)]
    return st.compare(
        *parts, models=["histogram", "gaussian"], draws=100, replicates=3, trials=50, thresholds=[0.9, 0.5], seed=3
    )


@pytest.fixture(scope="module")
def reproduction():
    agreeing = CrossCheck((RouteDifference("posterior", "numpy, filter", 0.0, 1e-10),), 1, 5, 0, 0, 0, 0, ())
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("solidtouch.analysis.reproduce.results.crosscheck_model", lambda *_, **__: agreeing)
        report = st.reproduce(data_sets=2, trials=5, thresholds=[0.9, 0.5], episodes=1, sequence_taps=0, seed=1)
        assert report.tree
        yield report


REPORTS = ("comparison", "reproduction")


@pytest.fixture(scope="module")
def stored(request, tmp_path_factory):
    """The file of a report, by name."""
    folder = tmp_path_factory.mktemp("stored")

    @cache
    def path(name):
        file = folder / ("compare.nc" if name == "comparison" else "results.nc")
        write_netcdf(request.getfixturevalue(name).tree, file)
        return file

    return path


@pytest.mark.parametrize(
    ("name", "names"),
    [
        pytest.param("comparison", ["sessions", "decisions"], marks=pytest.mark.slow),
        ("reproduction", ["fig4", "fig7"]),
        *(pytest.param(name, [], marks=pytest.mark.slow) for name in REPORTS),
    ],
)
def test_a_redrawn_figure_is_that_of_the_run(name, names, stored, command, tmp_path, request):
    """Byte by byte; and what the file does not hold is said where all are wanted."""
    report = request.getfixturevalue(name)
    done = command("redraw", stored(name), *names, "--out", tmp_path / "out")
    files = {path.stem: path.read_bytes() for path in (tmp_path / "out").iterdir()}

    assert done.code == 0
    assert set(files) == set(names or report.figures) - {"fig3"}
    assert ("Without fig3: it shows single taps" in done.out) == (name == "reproduction" and not names)
    for figure, svg in files.items():
        assert drawing_of(report.plot(figure)).svg == svg, figure


def test_a_figure_in_another_style_and_format(stored, command, tmp_path):
    """Beside the file, in a folder of the style; existing files only with --force."""
    file = tmp_path / "results.nc"
    file.write_bytes(stored("reproduction").read_bytes())
    done = command("redraw", file, "contacts", "--style", "paper", "--format", "pdf")

    assert done.code == 0
    assert {path.name for path in (tmp_path / "figures-paper").iterdir()} == {"contacts.pdf"}
    again = command("redraw", file, "contacts", "--style", "paper", "--format", "pdf")
    assert again.code == 2
    assert "contacts.pdf: already exists" in again.err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("fig9",), "the figure 'fig9' cannot be drawn: the file's figures are fig4, "),
        (("fig3",), "the figure 'fig3' cannot be drawn: it shows single taps, which the file does not hold."),
    ],
)
def test_a_figure_that_cannot_be_drawn_is_named(words, said, stored, command, tmp_path):
    done = command("redraw", stored("reproduction"), *words, "--out", tmp_path / "out")

    assert done.code == 2
    assert said in " ".join(done.err.split())
    assert not (tmp_path / "out").exists()


def test_other_files_are_refused(stored, command, tmp_path):
    """Also one without what an earlier version did not write, and one that lacks a group."""
    other, older, cut = (tmp_path / f"{name}.nc" for name in ("other", "older", "cut"))
    xr.Dataset({"x": ("y", np.zeros(2))}).to_netcdf(other, engine="h5netcdf")
    for path in (older, cut):
        path.write_bytes(stored("reproduction").read_bytes())
    with h5py.File(older, "a") as before:
        del before.attrs["grid"]
    with h5py.File(cut, "a") as lacking:
        del lacking["examples"]
    for path, said in (
        (other, "not a file of results; expected"),
        (older, "not a file of results of an earlier"),
        (cut, "not a whole file of results: 'examples/clear'"),
    ):
        done = command("redraw", path)
        assert done.code == 2
        assert said in " ".join(done.err.split())


def test_a_model_and_a_tap_set_are_called_so(make_taps, command, tmp_path):
    """Their numbers of format are not those of files of results."""
    taps = make_taps()
    taps.save(tmp_path / "taps.nc")
    st.fit(taps).save(tmp_path / "model.nc")
    with xr.open_dataset(tmp_path / "model.nc", engine="h5netcdf") as model:
        assert model.attrs["format"] == 2
    for name, what in (("model", "a fitted model"), ("taps", "a tap set")):
        done = command("redraw", tmp_path / f"{name}.nc")
        assert done.code == 2
        said = f"{name}.nc: not a file of results, but {what}; expected `results.nc` or `compare.nc`."
        assert said in " ".join(done.err.split())


def documented(section):
    """Rows of the tables of a section: groups, variable, dims and unit of each."""
    text = DOCUMENT.read_text(encoding="utf-8").split(f"\n## `{section}`\n")[1].split("\n## ")[0]
    rows = {}
    for part in text.split("\n### ")[1:]:
        head, _, body = part.partition("\n")
        groups = [word.strip("`") for word in head.split(", ")]
        for line in body.splitlines():
            cells = [cell.strip() for cell in line.strip("|").split(" | ")]
            if line.startswith("| `"):
                for group in groups:
                    for variable in cells[0].split(", "):
                        rows[group, variable.strip("`")] = cells[1], cells[2]
    return rows


@pytest.mark.parametrize(
    ("name", "section"),
    [pytest.param("comparison", "compare.nc", marks=pytest.mark.slow), ("reproduction", "results.nc")],
)
def test_every_variable_is_documented(name, section, stored):
    """With its dims and unit; bounds and differences are described once for all."""
    rows, seen = documented(section), set()
    with xr.open_datatree(stored(name), engine="h5netcdf") as tree:
        groups = {group.path.strip("/"): group.to_dataset().load() for group in tree.subtree}
    for path, group in groups.items():
        for variable, data in group.data_vars.items():
            plain = str(variable).removesuffix("_low").removesuffix("_high")
            plain = plain.removesuffix("_difference").removesuffix("_step")
            dims, unit = rows[path, plain]
            seen.add((path, plain))
            assert dims == ", ".join(map(str, data.dims)), (path, variable)
            if data.attrs.get("units"):
                assert unit in (data.attrs["units"], "unit of errors"), (path, variable)

    optional = {"folds_left_out"}
    assert {row for row in rows if row not in seen and row[0] not in optional} == set()
