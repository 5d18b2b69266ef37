"""Values of a map, and its keys in messages."""

import math

import pytest
from solidtouch.models.errors import InputError
from solidtouch.models.io.layouts.mapping import TapMap, check_cutting, load_map, option

ODD = [5, -5, 0, 1.5, math.nan, math.inf, "x", "", True, [], ["x"], [5], {}, object(), b"x", None, 10**30]


def refusal(key, value):
    try:
        TapMap(**{key: value})
    except InputError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("key", TapMap.__struct_fields__)
def test_any_value_is_taken_or_refused_by_its_key(key):
    messages = [message for value in ODD if (message := refusal(key, value))]
    assert len(messages) >= 8
    assert {message.split(" must ")[0] for message in messages} == {key}


def test_one_kind_of_taxels_and_one_further_array_need_no_list(tmp_path):
    (tmp_path / "map.toml").write_text('leave_out = "dead"\nextra = "depth"\nwhere = ["x"]\n')
    how = load_map(tmp_path / "map.toml")
    assert (how.leave_out, how.extra, how.where) == (("dead",), ("depth",), "x")
    assert TapMap(leave_out="both") == TapMap(leave_out=["both"]) == TapMap(leave_out=("dead", "saturated"))


@pytest.mark.parametrize("key", ["scale", "where_scale"])
def test_a_factor_of_0_is_refused(key):
    with pytest.raises(InputError, match=f"{key} must not be"):
        TapMap(**{key: 0})


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"window": 3}, r"window \(--window\) 3 requires trigger \(--trigger\)"),
        ({"tare_samples": 3}, r"tare_samples \(--tare-samples\) 3 requires trigger"),
        ({"signal": "s"}, r"signal \(--signal\) s requires trigger"),
        ({"level": 3.0}, r"level \(--level\) 3.0 requires trigger \(--trigger\) or align \(--align\) contact"),
        ({"level": 3.0, "align": "peak"}, r"level \(--level\) 3.0 requires trigger"),
        ({"align": "contact"}, r"align \(--align\) contact requires level \(--level\)"),
        ({"pre": 3}, r"pre \(--pre\) 3 requires a press"),
        ({"trigger": "clock", "window": 5, "pre": 3}, r"pre \(--pre\) 3 requires a press"),
        ({"trigger": "signal", "signal": "s", "window": 3, "pre": 3}, r"pre \(--pre\) 3 requires a larger window"),
        ({"trigger": "clock"}, r"trigger \(--trigger\) clock requires window"),
        ({"trigger": "clock", "window": 0}, r"trigger \(--trigger\) clock requires window"),
        ({"trigger": "contact", "window": 3}, r"trigger \(--trigger\) contact requires level"),
        ({"trigger": "events", "window": 3}, r"trigger \(--trigger\) events requires events \(--events\)"),
        ({"trigger": "clock", "window": 3, "tare": "tap"}, r"tare \(--tare\) tap requires tare_samples"),
        ({"trigger": "clock", "window": 3, "tare_samples": 1}, r"tare_samples .* 1 requires tare \(--tare\) stream or"),
        ({"trigger": "clock", "window": 3, "tare": "tap", "tare_samples": 4}, r"4 requires a larger window"),
    ],
)
def test_keys_that_cut_streams_name_what_they_require(keys, message):
    with pytest.raises(InputError, match=message):
        check_cutting(TapMap(**keys))


def test_what_belongs_together_is_taken():
    check_cutting(TapMap(align="peak", pre=3))
    check_cutting(TapMap(trigger="clock", window=3, tare="stream", tare_samples=9))
    check_cutting(TapMap(trigger="contact", level=-2.0, window=3, pre=2, tare="none"))


def test_an_axis_of_a_plane_and_a_further_array_are_named_by_their_key():
    assert option("y") == "where (--where) y"
    assert option("extra:depth") == "extra (--extra) depth"
