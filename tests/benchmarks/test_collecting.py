"""What the campaign of disturbed collections calls lost or wrong."""

import random
from types import SimpleNamespace

import numpy as np
import pytest
from solidtouch.hardware.recording.collection import collect
from solidtouch.hardware.recording.recording import Recorder
from solidtouch.hardware.recording.settings import about_rig

from benchmarks.checks.collecting import KINDS, Disturber, rows
from benchmarks.checks.kills import Known, recorded

KIND = "disk becomes full"
ERROR = "solidtouch: 1.mcap: writing failed: No space left on device; the recording so far can be read.\n"


@pytest.fixture
def disturber(fake_rig, tmp_path, monkeypatch):
    """After a run that left 3 of 8 taps; `--resume` writes the whole plan."""
    (tmp_path / "plan.toml").write_text(fake_rig.PLAN)
    disturber = Disturber(tmp_path, SimpleNamespace(above_mm=lambda: disturber.above_mm), random.Random(0))  # noqa: S311 - no secret
    disturber._kind, disturber._files, disturber.above_mm = KIND, 1, 0.0

    def write(number):
        plan = fake_rig.fake_plan()
        with Recorder.create(disturber._path, about_rig(fake_rig.fake_settings(), "", plan), force=True) as recorder:
            rig = fake_rig.FakeRig(recorder).connect()
            collect(rig, list(plan.taps())[:number], plan.objects, 0, fake_rig.FakeOperator(), recorder)

    write(3)
    monkeypatch.setattr(disturber, "_start", lambda *_: None)
    monkeypatch.setattr(disturber, "_end", lambda _: (write(8), (0, ""))[1])
    return disturber


def test_taps_that_are_there_in_the_end_are_kept(disturber):
    disturber._judge((2, ERROR + "3 of 8 taps recorded; continue with --resume."), {2}, Known())

    ends = disturber.ends[KIND]
    assert (ends.kept, ends.lost, ends.completed, ends.wrong) == (3, 0, 1, [])
    assert f"| {KIND} | 0 | 1 × 2 | 3 | 0 | 1 of 0 | 0 |" in rows(disturber.ends)
    assert len(rows(disturber.ends).splitlines()) == 2 + len(KINDS)


@pytest.mark.parametrize("change", [lambda samples: samples + 1, None])
def test_taps_that_changed_or_disappeared_are_lost(disturber, change):
    before = recorded(disturber._path)
    before.taps[7 if change is None else 2] = np.ones(1) if change is None else change(before.taps[2])
    disturber._judge((2, ERROR + "3 of 8 taps recorded; continue with --resume."), {2}, before)

    assert disturber.ends[KIND].lost == 1


WRONG = {
    "another number": (2, ERROR + "4 of 8 taps recorded; continue with --resume.", 0.0, "4 taps are said to be kept"),
    "two sentences": (2, 2 * ERROR + "3 of 8 taps recorded; continue with --resume.", 0.0, "exit code 2"),
    "a traceback": (2, ERROR + "Traceback\n3 of 8 taps recorded; continue with --resume.", 0.0, "exit code 2"),
    "another code": (1, ERROR + "3 of 8 taps recorded; continue with --resume.", 0.0, "exit code 1"),
    "no word of a file": (2, ERROR, 0.0, "without a word"),
    "a finger": (2, ERROR + "3 of 8 taps recorded; continue with --resume.", 1.5, "the finger is 1.50 mm deep"),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_must_not_be_is_said(disturber, case):
    code, said, disturber.above_mm, sentence = WRONG[case]
    disturber._judge((code, said), {2}, Known())

    assert any(sentence in wrong for wrong in disturber.ends[KIND].wrong)
