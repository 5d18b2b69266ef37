"""The first approach finds where the object begins, slowly, and says what is wrong."""

import msgspec
import numpy as np
import pytest
from solidtouch.hardware.errors import StaleSensor
from solidtouch.hardware.rig.approach import SLOW_MM_S, approach


def middle(bench):
    limits = bench.settings.range
    return (limits.start_mm + limits.end_mm) / 2


def test_it_finds_the_object_and_lifts_the_finger(rig_bench):
    """Contact is found within 0.4 mm of where the readings begin to rise, at a tenth of the speed of a tap."""
    with rig_bench.rig() as rig:
        rig.slow_mm_s = SLOW_MM_S
        rig_bench.places.clear()
        rig_bench.felt.clear()
        found = approach(rig, middle(rig_bench))
        y, felt = np.array(rig_bench.places)[:, 1], np.array(rig_bench.felt).max(axis=1)

    begins = y[felt > felt[:20].mean() + 8].min()
    assert found.wrong == []
    assert begins - 0.1 <= found.contact_mm <= begins + 0.4
    assert y.max() <= found.contact_mm + 0.01
    assert rig_bench.is_clear
    assert np.diff(y).max() < 0.02 * 1.5 * SLOW_MM_S


def test_without_an_object_it_ends_at_the_depth_of_a_tap(rig_bench):
    tap = msgspec.structs.replace(rig_bench.settings.tap, depth_mm=2.43)
    with rig_bench.rig(settings=msgspec.structs.replace(rig_bench.settings, tap=tap)) as rig:
        rig_bench.emulation.control({"object": None})
        found = approach(rig, middle(rig_bench))

    assert found.contact_mm is None
    assert "nothing was touched between y = 0 and 2.43 mm" in found.wrong[0]
    assert abs(np.array(rig_bench.places)[:, 1].max() - 2.43) < 0.01
    assert rig_bench.is_clear


def test_an_object_that_begins_where_the_finger_passes_is_named(rig_bench):
    tap = msgspec.structs.replace(rig_bench.settings.tap, clear_mm=0.6)
    with rig_bench.rig(settings=msgspec.structs.replace(rig_bench.settings, tap=tap)) as rig:
        found = approach(rig, middle(rig_bench))

    assert found.contact_mm is not None
    assert [("may touch it in passing" in sentence) for sentence in found.wrong] == [True] * (
        found.contact_mm < 0.6 + 0.3
    )


def test_a_silent_sensor_ends_it(rig_bench):
    with rig_bench.rig() as rig:
        rig_bench.diary.when("command", lambda: rig_bench.on("silent_sensor"), lambda sent: b"Y-3" in sent[1])
        with pytest.raises(StaleSensor, match="no reading for"):
            approach(rig, middle(rig_bench))

    assert rig_bench.is_clear
