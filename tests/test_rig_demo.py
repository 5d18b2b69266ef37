"""The demonstration of the rig, every command as a new user types it, in processes of their own."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

DEMO = Path(__file__).parents[1] / "docs" / "examples" / "rig-demo.sh"


@pytest.mark.slow
def test_the_demonstration_goes_from_training_data_to_decisions(tmp_path):
    """Two sessions are collected whole, a model is fitted, and both engines agree on every tap of two episodes."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    done = subprocess.run(
        [DEMO, DEMO.with_name("demo-plan.toml"), tmp_path],
        env=os.environ | {"PATH": path},
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    printed = " ".join(done.stdout.split())

    assert done.returncode == 0, done.stdout + done.stderr
    assert "No problems found." in printed
    assert printed.count(".mcap: 640 taps;") == 2
    assert "All routes agree." in printed
    assert len(re.findall(r"decided: \d+ mm rod", printed)) == 2
    medians_ms = [float(ms) for ms in re.findall(r"Update latency: median (\S+) ms", printed)]
    assert len(medians_ms) == 3
    assert max(medians_ms) < 20
    assert (tmp_path / "live-perception.svg").is_file()


@pytest.mark.slow
def test_the_demonstration_leaves_no_devices_behind(tmp_path):
    """The emulators of a run that fails are ended too."""
    plan = tmp_path / "plan.toml"
    plan.write_text("session = 0\n")
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    done = subprocess.run(
        [DEMO, plan, tmp_path], env=os.environ | {"PATH": path}, capture_output=True, text=True, check=False
    )

    assert done.returncode == 2
    assert "missing key `positions`" in done.stderr or "missing key `objects`" in done.stderr
    assert sorted(item.name for item in (tmp_path / "bench-0").iterdir()) == ["rig.toml"]
