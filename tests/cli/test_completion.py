"""The Tab key completes commands, options, choices, models and presets, and leaves files to the shell."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from solidtouch.cli.main import run

PROGRAM = Path(sys.executable).parent / "solidtouch"
SHELLS = ("bash", "zsh", "fish")
PER = ("", "-per-mm", "-per-s")


@pytest.fixture
def completed(monkeypatch, capsys):
    """A function that returns what is offered for the last word of a line, as bash is told."""

    def complete(line):
        words = line.split(" ")
        monkeypatch.setenv("COMP_WORDS", line)
        monkeypatch.setenv("COMP_CWORD", str(len(words) - 1))
        monkeypatch.setenv("_SOLIDTOUCH_COMPLETE", "complete_bash")
        monkeypatch.setattr(sys, "argv", ["solidtouch"])
        with pytest.raises(SystemExit, match=r"^0$"):
            run()
        return capsys.readouterr().out.split()

    return complete


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("solidtouch comp", ["compare"]),
        ("solidtouch rig ", ["check", "approach"]),
        ("solidtouch fit --bi", ["--bins"]),
        ("solidtouch perceive --border uni", ["uniform", "uniform_what"]),
        ("solidtouch fit --model profile-", ["profile-ar", "profile-mvn"]),
        ("solidtouch compare --models histogram,gau", ["histogram,gaussian"]),
        ("solidtouch crosscheck --model al", ["all"]),
        ("solidtouch simulate --preset mo", ["model"]),
        ("solidtouch emulate --preset id", ["ideal"]),
        ("solidtouch perceive model.nc --rig rep", ["replay:"]),
        ("solidtouch perceive model.nc --move info-w", [f"info-w{w}{p}" for w in ("hat", "here") for p in PER]),
        ("solidtouch perceive model.nc --stop e", ["error:", "each-error:"]),
        ("solidtouch fit my_models.p", []),
        ("solidtouch fit --model my_models.p", []),
    ],
)
def test_a_word_is_completed(completed, line, offered):
    assert completed(line) == offered


def test_a_list_of_models_names_none_twice(completed):
    offered = completed("solidtouch compare --models histogram,gaussian,")

    assert "histogram,gaussian,student" in offered
    assert not {"histogram,gaussian,histogram", "histogram,gaussian,gaussian"} & set(offered)


@pytest.mark.parametrize("shell", SHELLS)
def test_each_shell_has_a_script(shell, monkeypatch, capsys):
    monkeypatch.setenv("_SOLIDTOUCH_COMPLETE", f"source_{shell}")
    monkeypatch.setattr(sys, "argv", ["solidtouch"])
    with pytest.raises(SystemExit, match=r"^0$"):
        run()

    assert "_SOLIDTOUCH_COMPLETE=complete_" in capsys.readouterr().out


def in_shell(shell, script):
    path = os.pathsep.join([str(PROGRAM.parent), os.environ["PATH"]])
    environment = os.environ | {"PATH": path}
    return subprocess.run([shell, "-c", script], env=environment, capture_output=True, text=True, check=True)


@pytest.mark.skipif(not Path("/bin/bash").exists(), reason="bash is not installed")
def test_bash_completes_by_the_script_that_it_is_given():
    """And no library of data is loaded for that."""
    script = """
eval "$(_SOLIDTOUCH_COMPLETE=source_bash solidtouch)"
COMP_WORDS=(solidtouch fit --mod) COMP_CWORD=2
_solidtouch_completion solidtouch
echo "${COMPREPLY[@]}"
_SOLIDTOUCH_COMPLETE=complete_bash COMP_WORDS="solidtouch perceive m.nc --move fixa" COMP_CWORD=4 \
    PYTHONPROFILEIMPORTTIME=1 solidtouch
"""
    done = in_shell("/bin/bash", script)

    assert done.stdout.split() == ["--model", "fixation"]
    loaded = {line.rpartition("|")[2].strip() for line in done.stderr.splitlines()}
    assert "solidtouch.inference.names" in loaded
    assert not loaded & {"xarray", "jax", "numba", "scipy", "pandas"}


@pytest.mark.skipif(shutil.which("fish") is None, reason="fish is not installed")
def test_fish_completes_by_the_script_that_it_is_given():
    done = in_shell("fish", "_SOLIDTOUCH_COMPLETE=source_fish solidtouch | source; complete -C 'solidtouch fit --mod'")

    assert done.stdout.startswith("--model\t")


@pytest.mark.skipif(shutil.which("zsh") is None, reason="zsh is not installed")
def test_zsh_completes_by_the_script_that_it_is_given():
    """Which tells `_arguments` what is offered."""
    script = """
compdef() {}
_arguments() { print -r -- $* }
eval "$(_SOLIDTOUCH_COMPLETE=source_zsh solidtouch)"
words=(solidtouch fit --mod) CURRENT=3
_solidtouch_completion
"""
    assert '"--model":' in in_shell("zsh", script).stdout
