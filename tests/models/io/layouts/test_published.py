"""Maps of published recordings, each on a small copy of the layout."""

from pathlib import Path

import pytest
import typer
from published_layouts import LAYOUTS
from slow_cases import slow_but
from solidtouch.cli.convert import convert
from solidtouch.models.errors import InputError
from solidtouch.models.taps import TapSet
from typer.testing import CliRunner

MAPS = Path(__file__).parents[4] / "docs/datasets"
app = typer.Typer()
app.command()(convert)


def converted(folder, name, out):
    result = CliRunner().invoke(app, [str(folder), str(out), "--map", str(MAPS / f"{name}.toml")])
    if isinstance(result.exception, InputError):
        raise result.exception
    assert result.exit_code == 0, result.output
    return TapSet.load(out), result.output


def test_every_map_has_a_layout():
    assert sorted(LAYOUTS) == sorted(path.stem for path in MAPS.glob("*.toml"))


DIFFERENT = ["biotac-slide-compiled", "biotac-slide", "cost", "eflesh", "icub-forearm"]
DIFFERENT += ["opentouch", "phac-hold", "uskin-slip"]
"""Of many formats and ways to tell taps apart."""


@pytest.mark.parametrize("name", slow_but(DIFFERENT, LAYOUTS))
def test_a_published_layout_becomes_taps(name, tmp_path):
    folder = tmp_path / "as published"
    folder.mkdir()
    facts = LAYOUTS[name](folder)

    taps, text = converted(folder, name, tmp_path / "taps.nc")

    assert taps.taps.shape == facts.shape
    assert tuple(taps.what_name) == facts.objects
    assert tuple(taps.dataset["where_value"].values) == facts.positions
    assert tuple(sorted(set(taps.session.tolist()))) == facts.sessions
    rate = taps.preprocessing.rate_hz
    assert rate == (facts.rate_hz if facts.rate_hz is None else pytest.approx(facts.rate_hz, rel=1e-3))
    second_sample, second_taxel = min(1, facts.shape[1] - 1), min(1, facts.shape[2] - 1)
    for number, (*labels, samples) in facts.taps.items():
        tap = taps.taps[number]
        assert [taps.what_name[taps.what[number]], taps.where[number], taps.session[number]] == labels
        assert (tap[0, 0], tap[0, second_taxel], tap[second_sample, 0], tap[-1, -1]) == samples
    for key, values in facts.extra.items():
        assert taps.dataset[key].values.tolist() == values
    assert "Licence: " in text
    assert "Cite as: " in text
