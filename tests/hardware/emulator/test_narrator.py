"""What an emulated bench tells of itself."""

from solidtouch.hardware.emulator.narrator import Narrator


def test_taps_moves_objects_and_faults_are_told(rig_bench):
    """Each in one line, with the time; nothing is told twice, and rest is not told."""
    lines = []
    narrator = Narrator(rig_bench.emulation, rig_bench.settings.tap, lines.append)
    advance = rig_bench.emulation.bench.advance

    def told(*asked):
        answer = advance(*asked)
        narrator.look()
        return answer

    rig_bench.emulation.bench.advance = told
    with rig_bench.rig() as rig:
        lines.clear()
        rig.move(2)
        rig.tap()
        rig_bench.on("lost_frames", times=1)
        rig_bench.emulation.control({"object": None})
        rig.loop.sleep(0.5)
    words = [line.split(" s  ")[1] for line in lines]
    moved, tap, *others = words

    assert moved == f"moved to x = {rig.place_mm:.2f}, y = 0.00 mm"
    assert tap.startswith(f"tap at x = {rig.place_mm:.2f} mm, y up to 2.4") or tap.endswith("2.50 mm")
    assert others[:2] == ["no object", "fault lost_frames, 1 so far"]
    times = [float(line.split(" s  ")[0]) for line in lines]
    assert times == sorted(times)
