"""Commands run without the extras of pyproject.toml and without what Windows lacks, and what needs that says so."""

import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from solidtouch.models.extras import EXTRAS, extra, missing

PROJECT = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8"))
BARE = """
import contextlib, io, json, sys
for name in json.loads(sys.argv[1]):
    sys.modules[name] = None
from solidtouch.cli.main import run
for sys.argv[1:] in json.loads(sys.argv[2]):
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()) as said:
        try:
            code = run() or 0
        except SystemExit as stopped:
            code = stopped.code
    print(json.dumps([code, said.getvalue()]))
"""


def names(requirements):
    """Packages of a list of requirements, without their versions."""
    return {re.split(r"[><=\[; ]", line)[0] for line in requirements}


def ended(blocked, lines, before=""):
    """Exit code and what each command printed, in a process that lacks modules."""
    words = json.dumps(blocked), json.dumps([list(map(str, line)) for line in lines])
    program = [sys.executable, "-c", before + BARE, *words]
    done = subprocess.run(program, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr
    return dict(zip(lines, map(json.loads, done.stdout.splitlines()), strict=True))


def test_each_package_of_an_extra_is_listed_where_pyproject_has_it():
    extras = PROJECT["project"]["optional-dependencies"]
    listed = {(found.name, found.package) for found in EXTRAS.values()}

    assert listed == {
        (name, package) for name in extras if name not in ("all", "docs") for package in names(extras[name])
    }
    assert extras["all"] == [f"solidtouch[{','.join(sorted({found.name for found in EXTRAS.values()}))}]"]
    assert {found.package for found in EXTRAS.values()} <= names(PROJECT["dependency-groups"]["dev"])
    assert not {found.package for found in EXTRAS.values()} & names(PROJECT["project"]["dependencies"])


def test_a_missing_package_is_named_with_its_extra():
    with (
        pytest.raises(
            ValueError, match=r"^A rig, real or emulated, needs pyserial: pip install 'solidtouch\[rig\]'\.$"
        ),
        extra("serial"),
    ):
        raise ModuleNotFoundError


def test_without_extras_commands_run_or_name_the_extra(taps_file, tmp_path):
    """In a process that has none; examples of each command that may need one."""
    model, table = tmp_path / "model.nc", tmp_path / "taps.parquet"
    table.write_bytes(b"PAR1")
    (tmp_path / "taps.mcap").touch()
    rig = Path(__file__).parents[2] / "docs/examples/rig.toml"
    lines = {
        ("fit", taps_file, "--out", model, "--bins", 9): None,
        (
            "perceive",
            model,
            "--rig",
            f"replay:{taps_file}",
            "--deadline",
            3,
            "--training-taps",
            "--engine",
            "numpy",
        ): None,
        ("inspect", taps_file): None,
        ("inspect", tmp_path / "taps.mcap"): "mcap",
        ("convert", "--look", table): "pyarrow",
        ("rig", "check", rig): "serial",
        ("collect", rig, rig.with_name("plan.toml"), "--out", tmp_path / "new.mcap"): "mcap",
        ("strategies", "--scheduler", "tcp://127.0.0.1:1"): "distributed",
    }
    ends = ended([*EXTRAS, "dask"], lines)
    for line, needed in lines.items():
        code, said = ends[line]
        assert code == (2 if needed else 0), (line, said)
        assert "Finger" not in said, (line, said)
        assert (missing(needed) in " ".join(said.split())) if needed else "needs" not in said, (line, said)


POSIX = """
import os, select, signal
import asyncio, concurrent.futures.process, multiprocessing.popen_fork, shutil, tempfile  # these check the system
import jax, tornado.httpserver, zarr
for module, names in {
    os: "fork forkpty openpty killpg getpgid setsid setpgid mkfifo",
    select: "poll epoll",
    signal: "SIGALRM SIGHUP SIGKILL SIGUSR1 setitimer getitimer ITIMER_REAL pthread_sigmask pthread_kill sigwait",
}.items():
    for name in names.split():
        if hasattr(module, name):
            delattr(module, name)
"""


@pytest.mark.slow
def test_without_posix_commands_run_or_say_that_they_need_it(tmp_path):
    """As on Windows, but for paths and files, which behave as here."""
    data, model = tmp_path / "data", tmp_path / "model.nc"
    taps = data / "session-0.nc", data / "session-1.nc"
    rig = Path(__file__).parents[2] / "docs/examples/rig.toml"
    lines = {
        ("simulate", "--out", data): True,
        ("inspect", taps[1]): True,
        ("fit", *taps, "--out", model): True,
        ("perceive", model, "--deadline", 5): True,
        ("trials", model, taps[1], "--trials", 1000): True,
        ("reproduce", "--quick", "--out", tmp_path / "report"): True,
        ("emulate", "--out", tmp_path / "emulated"): False,
        ("sweep", rig.with_name("study.toml"), "--out", tmp_path / "study.zarr"): False,
        ("collect", rig, rig.with_name("plan.toml"), "--out", tmp_path / "new.mcap"): False,
    }
    ends = ended(["fcntl", "grp", "pwd", "pty", "resource", "termios", "tty"], lines, POSIX)

    for line, runs in lines.items():
        code, said = ends[line]
        assert code == (0 if runs else 2), (line, said)
        assert runs or "needs Linux or macOS" in said, (line, said)
