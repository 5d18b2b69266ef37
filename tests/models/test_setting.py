"""Setting files: what is written is read, and what is not right is named."""

import json

import numpy as np
import pytest
from solidtouch.models.errors import InputError
from solidtouch.models.measurement.registry import fit_model
from solidtouch.models.setting_file import KEYS, Setting, load_setting
from solidtouch.models.settings import FitSettings

WHOLE = Setting.of(
    model="session:profile",
    power=0.0279,
    saturation=2.73,
    bins=64,
    pseudocount=0.5,
    value_range="taxel",
    where_cell="0.5mm",
    what_cell="4mm",
    threshold=0.7,
    border="clamp",
    theta_x=0.25,
    fixation=3,
    passive=True,
    deadline=60,
    note="learned on session 1 of rods.nc, 2.5 µm",
)


MADE = {"whole": WHOLE, "none": Setting(), "JK": Setting.of(power="JK", saturation=3)}


@pytest.mark.parametrize("setting", MADE.values(), ids=MADE.keys())
def test_a_setting_survives_its_file(tmp_path, setting):
    """With every field under its name, and nothing else but the format."""
    setting.save(tmp_path / "a.json")
    written = json.loads((tmp_path / "a.json").read_text(encoding="utf-8"))

    assert load_setting(tmp_path / "a.json") == setting
    assert written == {"format": 1} | setting.values()


def test_the_whole_setting_differs_from_the_default_everywhere():
    """So that the test above can miss nothing."""
    assert [key for key, value in WHOLE.values().items() if value == Setting().values()[key]] == []


def test_files_are_replaced_by_force_only(tmp_path):
    WHOLE.save(tmp_path / "a.json")
    with pytest.raises(InputError, match=r"a\.json: already exists; use --force to overwrite it"):
        Setting().save(tmp_path / "a.json")
    Setting().save(tmp_path / "a.json", force=True)

    assert load_setting(tmp_path / "a.json") == Setting()


def written(path, **changes):
    """A file of the whole setting with some keys changed, those that are `...` left out."""
    values = {"format": 1} | WHOLE.values() | changes
    path.write_text(json.dumps({key: value for key, value in values.items() if value is not ...}), encoding="utf-8")
    return path


@pytest.mark.parametrize("key", list(KEYS))
def test_every_key_is_needed(tmp_path, key):
    with pytest.raises(InputError, match=rf"a\.json: missing key '{key}'"):
        load_setting(written(tmp_path / "a.json", **{key: ...}))


WRONG = {
    "model": ["neural", 3, None, "session:session", ["histogram"]],
    "power": ["learned", "j", 0, -1.0, None, True, float("nan"), 10**309, [1]],
    "saturation": [0, -1, "inf", float("inf"), False],
    "bins": [0, 1.5, "100", 65537, None, True],
    "pseudocount": [-0.1, None, float("inf")],
    "value_range": ["all", None, 1],
    "where_cell": [0.5, False],
    "what_cell": [3, []],
    "threshold": [-0.1, 1.1, "0.9", None],
    "border": ["wall", None, {}],
    "theta_x": [1.5, "0"],
    "fixation": [-1, 2.5, "middle"],
    "passive": [0, "no", None],
    "deadline": [0, 1e3, 10**7],
    "note": [None, 3],
}


def test_every_field_has_wrong_values_to_try():
    assert list(WRONG) == list(KEYS)


@pytest.mark.parametrize(("key", "value"), [(key, value) for key, values in WRONG.items() for value in values])
def test_wrong_values_are_named_with_file_and_key(tmp_path, key, value):
    """In one sentence that says what would be right."""
    with pytest.raises(InputError, match=rf"a\.json: {key} must be .*, got .*\.$"):
        load_setting(written(tmp_path / "a.json", **{key: value}))
    with pytest.raises(InputError, match=f"^{key} must be"):
        WHOLE.changed(**{key: value})


TEXTS = {
    "nothing": ("", "not JSON"),
    "no JSON": ("power = 3", "not JSON"),
    "a list": ("[1, 2]", "not a JSON object"),
    "a number twice": ('{"format": 1, "power": 1, "power": 2}', "repeated key power"),
    "another format": ('{"format": 2}', "of format 2; this version reads format 1"),
    "no format": ('{"power": 1}', "key 'format' is not 1"),
    "too deep": ("[" * 100_000, "not JSON"),
}


@pytest.mark.parametrize(("text", "message"), TEXTS.values(), ids=TEXTS.keys())
def test_files_that_are_no_setting_are_refused(tmp_path, text, message):
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(InputError, match=rf"a\.json:? .*{message}"):
        load_setting(tmp_path / "a.json")


def test_other_files_are_refused(tmp_path):
    (tmp_path / "bytes.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="not a valid setting file: not JSON"):
        load_setting(tmp_path / "bytes.json")
    with pytest.raises(InputError, match=r"none\.json: no such file"):
        load_setting(tmp_path / "none.json")
    with pytest.raises(InputError, match="cannot read"):
        load_setting(tmp_path)
    with pytest.raises(InputError, match=r"a\.json: unknown key 'colour'"):
        load_setting(written(tmp_path / "a.json", colour="red"))


@pytest.fixture(scope="module")
def fitted(make_taps):
    """A model of 9 bins, cells of 3 mm and an evidence of 2.5 taps at most, at power 1/J with J = 6."""
    taps = make_taps(L=4)
    settings = FitSettings(bins=9, saturation=2.5, gain_sd=0.1, offset_sd=0.0)
    return {
        name: fit_model(name, taps, taps.grid("3mm"), settings).model for name in ("histogram", "session", "profile")
    }


@pytest.mark.parametrize("power", ["J", 1 / 6])
@pytest.mark.parametrize(
    ("name", "called"), [("histogram",) * 2, ("profile",) * 2, ("session", "session"), ("session", "session:histogram")]
)
def test_a_model_of_the_setting_is_taken(fitted, name, called, power):
    """By what its power means and not by how it is written."""
    Setting.of(model=called, power=power, saturation=2.5, bins=9, where_cell="3mm").check_model(
        fitted[name], "m.nc", "s.json"
    )


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"model": "profile"}, r"m\.nc was fitted with model histogram, but the setting s\.json has profile"),
        ({"model": "session"}, "with model histogram, but the setting s.json has session"),
        ({"power": "JK"}, r"with power 0\.166667, but the setting s.json has 0\.0333333"),
        ({"saturation": None}, r"with saturation 2\.5, but the setting s.json has inf"),
        ({"saturation": 2}, r"with saturation 2\.5, but the setting s.json has 2"),
        ({"bins": 8}, "with bins 9, but the setting s.json has 8"),
        ({"where_cell": "1500um"}, r"with where_cell 3, but the setting s.json has 1\.5"),
    ],
)
def test_another_model_is_refused(fitted, changes, message):
    setting = Setting.of(saturation=2.5, bins=9).changed(**changes)
    with pytest.raises(InputError, match=message):
        setting.check_model(fitted["histogram"], "m.nc", "s.json")


def test_a_grid_without_edges_has_no_width_to_compare(make_taps):
    taps = make_taps()
    model = fit_model("gaussian", taps, taps.grid(), FitSettings()).model

    assert model.grid.where_edges is None
    assert np.isinf(model.saturation)
    Setting.of(model="gaussian", where_cell="7mm").check_model(model, "m.nc", "s.json")
