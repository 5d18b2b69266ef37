"""The cross-check of a reproduction in a process beside the study."""

import json
import subprocess
import sys

import pytest

SCRIPT = """
import json, os, signal
from solidtouch.analysis.page.stages import StageClock
from solidtouch.analysis.reproduce.check import check_ahead, checking_ahead
from solidtouch.analysis.tasks.beside import NotDone

def compared(progress):
    progress()
    return os.getpid()

def fails(progress):
    raise ZeroDivisionError

class Advanced(list):
    def __call__(self, name, total):
        return self.append

told = Advanced()
clock = StageClock(told)
with checking_ahead():
    other = check_ahead(compared, 3, clock).result()
    failed = isinstance(check_ahead(fails, 0, clock).exception(), NotDone)
    os.kill(other, signal.SIGKILL)
    killed = isinstance(check_ahead(compared, 0, clock).exception(), NotDone)
print(json.dumps([other != os.getpid(), told, failed, killed, check_ahead(compared, 1, clock)]))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="other systems compare engines after the trials")
def test_another_process_compares_the_engines():
    """Its stage advances; where it fails or is killed, the comparison is left to who asks."""
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == [True, [1, 2], True, True, None]
