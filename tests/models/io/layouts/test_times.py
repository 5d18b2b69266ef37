"""Times of files in seconds, however they are written."""

import numpy as np
import pytest
import xarray as xr
from solidtouch.models.errors import InputError
from solidtouch.models.io.layouts.mapping import TapMap
from solidtouch.models.io.layouts.tap_set import load_mapped
from solidtouch.models.io.layouts.times import in_seconds
from solidtouch.models.taps import check_alike, concatenate

AT = 1795687200.25  # 2026-11-26 10:00:00.25 in Greenwich


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("2026-11-26 10:00:00.25", AT),
        ("2026-11-26T10:00:00.250000Z", AT),
        ("2026-11-26T10:00:00.25+00:00", AT),
        ("2026-11-26 11:00:00.25+0100", AT),
        ("2026-11-26T04:30:00.25-05:30", AT),
        ("2026/11/26 10:00:00.25", AT),
        ("26.11.2026 10:00:00,25", AT),
        ("26.11.2026_10:00", AT - 0.25),
        ("2026-11-26", AT - 36000.25),
        ("26.11.2026", AT - 36000.25),
        ("9:05:07.5", 32707.5),
        ("[09:05:07.5]", 32707.5),
        ("10:00:00.123456789", 36000.123456789),
        ("23:59", 86340.0),
        ("0.005 sec", 0.005),
        ("-2e3ms", -2.0),
        ("1.5 min", 90.0),
        (".5 hr", 1800.0),
        ("", np.nan),
        ("NaT", np.nan),
    ],
)
def test_clocks_and_dates(text, seconds):
    assert in_seconds("time", "t", np.array([text]), "s").tolist() == pytest.approx([seconds], nan_ok=True, abs=1e-6)


@pytest.mark.parametrize(
    "text",
    ["11/12/2026 10:00", "26-11-2026", "10:00:00 AM", "tomorrow", "25:00:00", "10:61", "30.02.2026", "10", "0.5 N"],
)
def test_what_is_no_time_is_refused(text):
    """Also an order of day and month that nobody knows."""
    with pytest.raises(
        InputError, match=r"time \(--time\): t holds .*, not numbers or times such as 0.25 s, 2026-11-26 10:00"
    ):
        in_seconds("time", "t", np.array(["9:00", text]), "s")


def test_texts_with_units_may_be_missing():
    texts = np.array([["0 sec", "NaN"], ["", "20 msec"]])

    assert in_seconds("time", "t", texts, "ms") == pytest.approx(np.array([[0.0, np.nan], [np.nan, 0.02]]), nan_ok=True)


def test_numbers_have_a_unit():
    assert in_seconds("time", "t", np.array([1500]), "ms").tolist() == [1.5]
    with pytest.raises(InputError, match="t is in 'min'; say its unit with --time-unit"):
        in_seconds("time", "t", np.array([1500]), "min")


def timed(path, times, columns="t,f,g"):
    """A CSV file of two taxels with a row at each time, in taps of ten."""
    rows = (f"{time},{row},0,{row // 10}" for row, time in enumerate(times))
    path.write_text("\n".join([f"{columns},n", *rows]))
    return path


TAPS = TapMap(taxels=("f", "g"), time="t", tap="n")


def test_sessions_of_one_sensor_go_together(tmp_path, rng):
    """Times jitter by 0.2 ms; files of one tap with times in milliseconds differ more, and are of one rate."""
    parts = []
    for day in range(3):
        times = 1.7e9 + np.arange(200) / 200 + rng.uniform(-2e-4, 2e-4, 200)
        parts.append(load_mapped(timed(tmp_path / f"{day}.csv", map("{:.6f}".format, times)), TAPS).taps)
    check_alike(parts, ["0.nc", "1.nc", "2.nc"])
    short = [timed(tmp_path / f"s{n}.csv", [f"{n / 7 + i / 60:.3f}" for i in range(5)]) for n in range(10)]

    assert {part.preprocessing.rate_hz for part in parts} == {200.0}
    assert load_mapped(short, TAPS.changed(tap="file")).taps.preprocessing.rate_hz == 60.0


def test_rates_that_differ_are_told_with_the_way_out(tmp_path):
    one, other = (
        load_mapped(timed(tmp_path / f"{rate}.csv", np.arange(100) / rate), TAPS).taps for rate in (98.37, 98.43)
    )

    with pytest.raises(InputError, match=r"rate_hz is 98\.37 here and 98\.43 there\. If both .* --rate 98\.4\."):
        check_alike([one, other], ["one.nc", "other.nc"])
    with pytest.raises(
        InputError, match=r"92\.csv: 92 samples per second, .*98\.43\.csv 98\.43\. If .* --rate; else convert files of"
    ):
        load_mapped([tmp_path / "98.43.csv", timed(tmp_path / "92.csv", np.arange(100) / 92)], TAPS)


def test_sessions_of_several_rates_go_together_at_one(tmp_path):
    """Resampled each on its own; both then show the same wave."""
    parts = []
    for rate in (100, 200):
        at = np.arange(2 * rate) / rate
        path = tmp_path / f"{rate}.csv"
        path.write_text("t,s\n" + "".join(f"{t:.3f},{np.sin(8 * t):.6f}\n" for t in at))
        how = TapMap(taxels="s", time="t", trigger="clock", window=20, resample=50.0)
        parts.append(load_mapped(path, how).taps)
    joined = concatenate(parts)

    assert joined.preprocessing.rate_hz == 50
    np.testing.assert_allclose(parts[0].taps[1:-1], parts[1].taps[1:-1], atol=0.01)


def test_times_that_do_not_increase_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"time \(--time\) does not increase"):
        load_mapped(timed(tmp_path / "a.csv", [0.5] * 20), TAPS)


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
def test_numbers_since_1970_have_one_unit(tmp_path, unit):
    """Also those of events; a unit other than the second is told."""
    zeros = {"s": ".", "ms": "0", "us": "0000", "ns": "0000000"}[unit]
    numbers = [f"{170_000_000_000 + n}{zeros}" for n in range(200)]
    timed(tmp_path / "a.csv", [f"{each[:10]}.{each[10:12]}" if unit == "s" else each for each in numbers])
    (tmp_path / "events.csv").write_text("at\n1700000000.5\n1700000001.5\n")
    how = TAPS.changed(tap=None, trigger="events", events="events.csv:at", window=10, pre=2)
    taps, told = load_mapped(tmp_path / "a.csv", how)

    assert taps.taps[:, 2, 0].tolist() == [50.0, 150.0]
    assert taps.preprocessing.rate_hz == 100.0
    assert [sentence for sentence in told if "1970" in sentence] == (
        [] if unit == "s" else [f"time (--time) is read as {unit} since 1970."]
    )


@pytest.mark.parametrize(
    ("step", "begin", "told"),
    [
        (10, 0, "in s it gives 0.1 Hz, but 100 Hz in ms or 100000 Hz in us"),
        (1e7, 6e14, "in s it gives 1e-07 Hz, but 100 Hz in ns"),  # nanoseconds since the computer began, a week ago
        (1e-7, 0, "in s it gives 1e+07 Hz"),
        (0.01, 0, None),
    ],
)
def test_rates_of_no_sensor_are_told(tmp_path, step, begin, told):
    """If neither the unit nor the rate is said."""
    path = timed(
        tmp_path / "a.csv", [f"{begin + step * n:.9g}" if step < 1 else int(begin + step * n) for n in range(200)]
    )
    found = load_mapped(path, TAPS).told
    unit_said, rate_said = load_mapped(path, TAPS.changed(time_unit="s")), load_mapped(path, TAPS.changed(rate=100.0))

    assert [each for each in found if "Hz" in each] == (
        [f"time (--time): {told}{'; check time_unit (--time-unit)' * ('but' in told)}."] if told else []
    )
    assert not any("Hz" in each for each in (*unit_said.told, *rate_said.told))


def test_durations_as_matlab_writes_them(tmp_path):
    """By `writetimetable`."""
    taps = load_mapped(timed(tmp_path / "a.csv", [f"{n / 200:g} sec" for n in range(50)]), TAPS).taps

    assert taps.preprocessing.rate_hz == 200.0


def uneven(folder, steps, **how):
    """What is told of samples at times with these steps, and their rate."""
    for name in ("a", "b"):
        rows = (f"{time:.6f},{n}" for n, time in enumerate(np.cumsum(steps)))
        (folder / f"{name}.csv").write_text("t,f\n" + "\n".join(rows))
    found = load_mapped(folder, TapMap(taxels="f", tap="file", time="t", files="?.csv", **how))
    return [each for each in found.told if "even" in each], found.taps.preprocessing.rate_hz


def test_samples_at_uneven_times_are_told_with_their_steps(tmp_path):
    steps = np.random.default_rng(1).choice([0.005, 0.01, 0.03], 200)
    told, rate = uneven(tmp_path, steps)

    assert told == [
        f"{tmp_path / 'a.csv'} and 1 more file: steps of time (--time) are 5 to 30 ms, but samples are taken as even, "
        f"at {rate:g} Hz, also by resample (--resample); interpolate uneven ones in the files before."
    ]
    assert uneven(tmp_path, steps, rate=60.0)[0] == []


@pytest.mark.parametrize(
    "steps",
    [
        np.full(200, 0.01),
        0.01 + np.random.default_rng(2).normal(0, 0.001, 200),
        np.diff(np.round(np.arange(201) / 300, 3)),  # rounded to ms
        np.diff(np.floor(np.arange(201) * 1e-3 / 0.0156) * 0.0156),  # a clock of 15.6 ms
        np.where(np.arange(200) == 50, 0.02, 0.01),  # a sample is lost
        np.where(np.arange(200) == 50, 5, 0.01),  # a gap
    ],
)
def test_jitter_rounding_and_lost_samples_are_not_uneven(tmp_path, steps):
    assert uneven(tmp_path, steps)[0] == []


def test_times_of_data_sets_have_a_unit_since_a_date(tmp_path):
    """As xarray writes its dates: also those of sessions."""
    clock = np.datetime64("2026-11-26T10:00", "ns") + np.arange(6) * np.timedelta64(10, "ms")
    days = np.repeat(np.array(["2026-11-25", "2026-11-26"], "datetime64[ns]"), 3)
    data = {"x": (("time", "k"), np.arange(12.0).reshape(6, 2)), "day": ("time", days)}
    xr.Dataset(data, {"time": clock}).to_netcdf(tmp_path / "a.nc")
    how = TapMap(taps="x", axes="sample,taxel", time="time", session="date:day", trigger="clock", window=3)

    taps = load_mapped(tmp_path / "a.nc", how.changed(format="netcdf")).taps

    assert (taps.preprocessing.rate_hz, taps.session.tolist()) == (100.0, [0, 1])
    assert in_seconds("time", "t", np.array([1.5]), "hours since 1970-01-02") == 86400 + 5400
    with pytest.raises(InputError, match="t is in 'months since 2026-01-01'"):
        in_seconds("time", "t", np.array([1.5]), "months since 2026-01-01")


def test_clock_times_without_a_date_go_on_at_midnight(tmp_path):
    """Within a tap as well."""
    clock = [
        f"{(86399700 + 10 * n) % 86400000 // 3600000:02}:{(86399700 + 10 * n) // 60000 % 60:02}" for n in range(60)
    ]
    clock = [f"{text}:{(86399700 + 10 * n) % 60000 / 1000:06.3f}" for n, text in enumerate(clock)]
    taps = load_mapped(timed(tmp_path / "a.csv", clock), TAPS.changed(tap="file")).taps
    assert (clock[29], clock[30]) == ("23:59:59.990", "00:00:00.000")
    assert taps.preprocessing.rate_hz == 100
