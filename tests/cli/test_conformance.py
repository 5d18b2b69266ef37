"""`solidtouch conformance` as a user calls it."""

import json
import os
import shlex
import sys
import time
from xml.etree import ElementTree as ET

import pytest
from foreign_programs import FOLDER, node
from solidtouch.analysis.conformance.catalogue import catalogue, own_kit
from solidtouch.analysis.conformance.dataset.version import KIT_VERSION
from solidtouch.cli.main import app
from typer.testing import CliRunner

import solidtouch as st


def call(*words):
    done = CliRunner().invoke(app, ["conformance", *map(str, words)])
    return done.exit_code, " ".join(done.stdout.split()), done


def test_the_list_tells_every_case_and_what_it_tests():
    code, text, _ = call("list")

    assert code == 0
    assert text.endswith(f"{len(catalogue())} cases of kit {KIT_VERSION}.")
    assert f"core: {own_kit().sizes['core']} cases; each of the equations" in text
    assert "ten-thousand-taps" in text


def test_engines_run_on_chosen_cases():
    code, text, _ = call("run", "--engine", "numpy", "--case", "root-j", "--case", "ties", "--verbose")

    assert code == 0
    core = own_kit().sizes["core"]
    assert text == "Engine numpy root-j pass ties pass 2 of 2 cases pass. " + (
        f"Conformance kit {KIT_VERSION}: core: {core - 2} of {core} not asked."
    )


def test_an_engine_that_cannot_do_a_case_leaves_it_out():
    code, text, _ = call("run", "--engine", "numpyro", "--case", "shift-prior", "--case", "root-j")

    assert code == 0
    assert "shift-prior left out: The NumPyro models do not support border 'prior', which renormalises" in text
    assert "1 of 1 case passes, 1 left out. Conformance kit" in text


def test_exported_cases_can_be_answered_from_files(tmp_path):
    """Right answers give exit code 0, a wrong one 1 with its tap."""
    code, text, _ = call("export", tmp_path / "kit", "--case", "root-j")
    assert code == 0
    assert text.startswith(f"Cases in {tmp_path / 'kit'}: 1;")
    right = json.loads((tmp_path / "kit" / "root-j.json").read_text())["expected"]
    answers = tmp_path / "answers"
    answers.mkdir()
    (answers / "root-j.jsonl").write_text("\n".join(map(json.dumps, right)))
    assert call("check", "--answers", answers, "--case", "root-j")[0] == 0

    right[2]["move"] += 1
    (answers / "root-j.jsonl").write_text("\n".join(map(json.dumps, right)))
    code, text, _ = call("check", "--answers", answers, "--case", "root-j")
    assert code == 1
    assert "root-j DIFFERS tap 3: its move is" in text


def test_a_program_that_prints_rubbish_is_told_so():
    code, text, _ = call("check", "--command", shlex.join([sys.executable, "-c", "print(1)"]), "--case", "root-j")

    assert code == 1
    assert "root-j FAILED it writes line 1, which is not a JSON object: '1' 0 of 1 case passes, 1 failed." in text


@pytest.mark.parametrize(("name", "code"), [("TERM", 143), ("INT", 130)])
def test_a_signal_ends_the_program_too(command, tmp_path, name, code):
    script = f"echo $$ >{tmp_path / 'number'}; kill -{name} $PPID; exec sleep 60"
    began = time.monotonic()
    done = command("conformance", "check", "--command", shlex.join(["sh", "-c", script]), "--case", "root-j")

    assert (done.code, time.monotonic() - began < 30) == (code, True)
    with pytest.raises(ProcessLookupError):
        os.kill(int((tmp_path / "number").read_text()), 0)


def test_functions_print_and_write_what_the_command_does(command, tmp_path):
    """Programs, files of answers, engines and exported cases."""
    names = ["root-j", "fixation-first", "ties"]
    options = [word for name in names for word in ("--case", name)]
    program = shlex.join([*map(str, node()), str(FOLDER / "solid.js")])
    kit, answers = tmp_path / "kit", tmp_path / "answers"
    answers.mkdir()
    exported = command("conformance", "export", tmp_path / "command", *options)
    assert st.conformance.export(kit, names) == 3
    for name in names:
        lines = json.loads((kit / f"{name}.json").read_text())["expected"]
        lines[-1]["move"] = -7
        (answers / f"{name}.jsonl").write_text("\n".join(map(json.dumps, lines)))

    assert exported.code == 0
    assert {path.name: path.read_bytes() for path in kit.iterdir()} == {
        path.name: path.read_bytes() for path in (tmp_path / "command").iterdir()
    }
    for words, report, passed in (
        (("check", "--command", program), st.conformance.run_program(program, names), True),
        (("check", "--answers", answers), st.conformance.run_files(answers, names), False),
    ):
        done = command("conformance", *words, *options)
        assert done.out.splitlines() == report.lines()
        assert (done.code == 0) == report.passed == passed
    done = command("conformance", "run", "--engine", "numpy", "--verbose", *options)
    assert done.out.splitlines() == ["Engine numpy", *st.conformance.run_engine("numpy", names).lines()]


def test_a_report_replaces_the_text_or_is_a_file(tmp_path):
    """A file is replaced, as at each run of a CI job."""
    words = ("check", "--command", "true", "--case", "root-j")
    code, _, done = call(*words, "--report", "json")
    assert (code, json.loads(done.stdout)["cases"][0]["status"]) == (1, "differs")

    for _ in range(2):
        code, text, _ = call(*words, "--report", "junit", "--report-file", tmp_path / "report.xml")
        assert (code, "root-j DIFFERS tap 1: there is no answer" in text) == (1, True)
    (test,) = ET.parse(tmp_path / "report.xml").iter("testcase")  # noqa: S314 - it was written here
    assert test.find("failure").get("message") == "tap 1: there is no answer"
    assert [path.name for path in tmp_path.iterdir()] == ["report.xml"]


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("check",), "Give either --command PROGRAM or --answers DIR."),
        (("check", "--command", "x", "--answers", "y"), "Give either --command PROGRAM or --answers DIR."),
        (("check", "--answers", "y", "--together"), "--together starts a program and does not go with --answers."),
        (("check", "--answers", "y", "--timeout", "10"), "--timeout stops a program and does not go with --answers."),
        (("check", "--command", ""), "command is empty; it must name a program."),
        (("check", "--command", "a 'b"), 'command "a \'b" cannot be read: No closing quotation.'),
        (("check", "--command", "/no/such"), "command: /no/such cannot be run: No such file or directory."),
        (("check", "--answers", "/no/such"), "answers /no/such: not a folder."),
        (("check", "--command", "x", "--without", "belief"), "without must be one of log_likelihood,"),
        (("check", "--command", "x", "--case", "y"), "case y: there is no such case"),
        (("run", "--case", "y"), "case y: there is no such case"),
        (("list", "--level", "y"), "level y: it must be one of core, episodes, borders, limits, cont"),
        (("check", "--command", "true", "--report-file", "x"), "--report-file needs --report json or --report junit."),
        (("check", "--command", "true", "--report", "json", "--report-file", "/no/such"), "no folder /no."),
    ],
)
def test_wrong_options_are_told_in_a_sentence(words, sentence):
    _, text, done = call(*words)

    assert (type(done.exception).__name__, text) == ("InputError", "")
    assert sentence in str(done.exception)


def test_the_commands_take_a_pinned_kit(command, tmp_path):
    kit = tmp_path / "kit"
    st.conformance.export(kit, ["root-j", "ties"])
    done = command("conformance", "list", "--kit", kit)
    assert (done.code, done.out.splitlines()[-1]) == (0, f"2 cases of kit {KIT_VERSION}.")
    done = command("conformance", "check", "--command", "true", "--kit", kit, "--case", "root-j")
    assert (done.code, "root-j  DIFFERS tap 1: there is no answer" in done.out) == (1, True)
    done = command("conformance", "run", "--engine", "numpy", "--kit", kit)
    assert (done.code, "2 of 2 cases pass." in done.out) == (0, True)
    (kit / "root-j.json").unlink()
    done = command("conformance", "check", "--command", "true", "--kit", kit)
    assert (done.code, done.out) == (2, "")
    assert done.err.endswith("incomplete: root-j.json is missing, which SHA256SUMS lists.\n")
