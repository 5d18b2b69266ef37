"""Programs that fail, flood, hang, close their streams or leave others running are stopped and told apart."""

import os
import sys
import time
import tracemalloc
from pathlib import Path

import pytest
from solidtouch.analysis.conformance.case import to_line
from solidtouch.analysis.conformance.catalogue import catalogue, expected
from solidtouch.analysis.conformance.program import Ended, run_program
from solidtouch.analysis.conformance.run import Asked, check_answers, check_program
from solidtouch.analysis.conformance.verdict import described
from solidtouch.models.errors import InputError

import solidtouch as st

CASE = catalogue()["root-j"]
ANSWERS = "".join(f"{to_line(answer.line(CASE.name))}\n" for answer in expected(CASE))


def shell(code):
    return ["sh", "-c", code]


def sentence(code, timeout=20.0):
    """The verdict on a shell script."""
    return described(*check_program(shell(code), [CASE], Asked(timeout=timeout)))


def gone(path):
    """Whether the process of a number in a file ends soon."""
    stat = Path("/proc", path.read_text().strip(), "stat")
    for _ in range(100):
        if not stat.exists() or ") Z " in stat.read_text():
            return True
        time.sleep(0.01)
    return False


@pytest.fixture
def right(tmp_path):
    """A shell command that writes the right answers."""
    (tmp_path / "answers").write_text(ANSWERS)
    return f"cat {tmp_path / 'answers'}"


def test_programs_that_fail_are_told_apart():
    ended = [run_program(shell(code), ["{}"], 20.0).failure for code in ("echo 1", "exit 3", "kill -SEGV $$")]

    assert ended == ["", "ended with exit code 3", "crashed with signal SIGSEGV"]


@pytest.mark.parametrize(
    ("code", "what"),
    [
        ("exit 3", "FAILED it ended with exit code 3"),
        ("kill -SEGV $$", "FAILED it crashed with signal SIGSEGV"),
        ("exec sleep 60", "FAILED it has not ended after 0.5 s and was stopped"),
        ("echo garbage", "FAILED it writes line 1, which is not JSON: 'garbage'"),
        ("exec yes", "FAILED it writes more than 24 MiB and was stopped"),
        ("exit 0", "DIFFERS tap 1: there is no answer"),
    ],
)
def test_the_last_lines_of_standard_error_are_shown_however_a_program_fails(code, what):
    """In the text and in both reports; a fourth line and blank ones are not."""
    words = shell(f"printf 'first\\nsecond\\n\\n third\\r\\n\\033[31mfourth\\n' >&2; {code}")
    report = st.conformance.run_program(words, ["root-j"], timeout=0.5 if "sleep" in code else 20.0)
    (line, *_), said = report.lines(), "it said: second | third | ?[31mfourth"

    assert line == f"root-j  {what}; {said}"
    assert report.as_object()["cases"][0]["sentence"].endswith(said)
    assert report.as_junit().count(said) == 2


def test_standard_error_is_shown_where_all_cases_are_asked_together(right):
    words = shell(f"echo no memory >&2; {right}; kill -SEGV $$")
    found = list(check_program(words, [CASE, catalogue()["fit"]], Asked(), together=True))

    assert [verdict.sentence.endswith("; it said: no memory") for verdict in found] == [True, True]


def test_standard_error_of_a_program_that_answers_is_its_own(right):
    """Also where an answer differs."""
    assert sentence(f"echo slow >&2; {right}") == "pass"
    assert "slow" not in sentence(f'echo slow >&2; {right} | sed \'s/"move":1/"move":0/\'')


@pytest.mark.parametrize("end", ["exit 3", "kill -SEGV $$", "exec sleep 60"])
def test_much_standard_error_is_cut_and_holds_nothing_up(end):
    """Neither a long line nor twenty megabytes."""
    found = sentence(
        f"yes | head -c 20000000 >&2; head -c 100000 /dev/zero | tr '\\0' x >&2; {end}", 3.0 if "sleep" in end else 20.0
    )

    assert found.startswith("FAILED it ")
    assert found.endswith(f"it said: {'x' * 200}")


@pytest.mark.parametrize(
    ("code", "what"),
    [
        ("exec yes", "writes more than 24 MiB"),
        ("exec yes ''", "writes more than 24 MiB"),
        ("exec tr '\\0' x </dev/zero", "writes a line of more than 256 KiB"),
        ("exec cat /dev/urandom", "writes more than 24 MiB"),
        ("exec yes >&2", "writes more than 24 MiB to standard error"),
        ("yes >&2 & exec yes 0", "writes more than 24 MiB"),
        ("head -c 9999 /dev/zero; exec cat /dev/zero", "writes a line of more than 256 KiB"),
    ],
)
def test_a_flood_is_stopped_in_bounded_memory(code, what):
    tracemalloc.start()
    try:
        found = sentence(code)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()

    assert found.startswith(f"FAILED it {what}")
    assert found.removeprefix(f"FAILED it {what}").startswith(
        (" and was stopped", " to standard error and was stopped")
    )
    assert peak < 64e6


@pytest.mark.parametrize("flood", ["x", '{"case":"fit","tap":1}', '{"case":"root-j","tap":1}', ""])
def test_a_flood_is_stopped_in_bounded_memory_where_all_cases_are_asked_together(flood, right):
    """Answers before it count."""
    cases = [CASE, catalogue()["fit"], catalogue()["root-jk"]]
    tracemalloc.start()
    try:
        found = list(check_program(shell(f"{right}; exec yes '{flood}'"), cases, Asked(), together=True))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()

    assert "writes more than 24 MiB" in "".join(verdict.sentence for verdict in found)
    assert {verdict.status for verdict in found} <= {"pass", "failed"}
    assert found[0].status == ("pass" if "fit" in flood else "failed")
    assert peak < 64e6


def test_right_answers_without_end_are_too_many(right):
    assert sentence(
        f'{right}; n=5; while :; do echo \'{{"case":"root-j","tap":\'$n\'}}\'; n=$((n + 1)); done', 0.5
    ) == ("FAILED it has not ended after 0.5 s and was stopped after 5 answers")


@pytest.mark.parametrize(
    ("code", "what"),
    [
        ("sleep 60", "has not ended after 0.2 s and was stopped"),
        ("kill -STOP $$", "has not ended after 0.2 s and was stopped"),
        ("trap '' TERM INT HUP; while :; do sleep 60; done", "has not ended after 0.2 s and was stopped"),
        ("exec >&- 2>&-; sleep 60", "closed its output but has not ended after 0.2 s and was stopped"),
        ("exec <&-; sleep 60", "has not ended after 0.2 s and was stopped"),
    ],
)
def test_a_program_that_hangs_is_stopped_with_what_it_started(code, what, tmp_path):
    began = time.monotonic()

    assert sentence(f"sleep 60 >&- 2>&- & echo $! >{tmp_path / 'child'}; {code}", 0.2) == f"FAILED it {what}"
    assert time.monotonic() - began < 20.0
    assert gone(tmp_path / "child")


def test_the_time_of_a_case_is_not_that_of_all():
    """Hanging in each of several cases costs as many timeouts."""
    began = time.monotonic()
    found = list(check_program(shell("sleep 60"), [CASE] * 3, Asked(timeout=0.1)))

    assert [verdict.status for verdict in found] == ["failed"] * 3
    assert 0.3 <= time.monotonic() - began < 10.0


@pytest.mark.parametrize(
    ("left", "what"),
    [
        ("sleep 60", "kept its output open for 0.5 s and was stopped"),
        ("sleep 60 >/dev/null", "kept its output open for 0.5 s and was stopped"),
        ("sleep 60 >/dev/null 2>&1", "was stopped"),
    ],
)
def test_what_a_program_leaves_running_is_stopped_and_told(left, what, right, tmp_path):
    """The answers count."""
    found = sentence(f"{left} & echo $! >{tmp_path / 'child'}; {right}", 0.5)

    assert found.startswith("pass, but it left a process running")
    assert found.endswith(what)
    assert gone(tmp_path / "child")


def test_a_timeout_may_be_infinite_and_must_be_positive():
    assert sentence("exit 3", timeout=float("inf")).startswith("FAILED it ended with exit code 3")
    for wrong in (0.0, -1.0, float("nan"), "10"):
        with pytest.raises(InputError, match=f"timeout must be a positive number, got {wrong!r}"):
            st.conformance.run_program("true", ["root-j"], timeout=wrong)


def test_what_left_the_process_group_costs_no_more_than_the_timeout(right):
    """It cannot write any more."""
    began = time.monotonic()
    found = sentence(f"setsid sleep 5 & {right}", 0.5)

    assert found == "pass, but it left a process running that could not be stopped, as it left the process group"
    assert time.monotonic() - began < 4.0


def test_a_program_need_not_read_its_input():
    assert run_program(["true"], ["x" * 1000] * 10_000, 20.0) == Ended(b"", "")


@pytest.mark.parametrize(
    ("words", "reason"), [("./no-such", "No such file or directory"), ("/", "Permission denied"), ("", "No such file")]
)
def test_a_missing_program_is_named_before_any_case_is_asked(words, reason):
    with pytest.raises(InputError, match=f"command: {words} cannot be run: {reason}"):
        check_program([words], [], Asked())


def test_a_program_of_this_folder_is_named_by_its_path(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine").touch()
    with pytest.raises(
        InputError, match=r"command: mine cannot be run: No such file .*; in this folder it is \./mine\."
    ):
        check_program(["mine"], [], Asked())


def test_a_script_without_an_interpreter_is_named(tmp_path):
    (tmp_path / "script").write_text("\x7fnothing")
    (tmp_path / "script").chmod(0o755)

    with pytest.raises(InputError, match="script cannot be run: Exec format error"):
        list(check_program([str(tmp_path / "script")], [CASE], Asked()))


def test_what_a_program_says_does_not_paint_the_terminal():
    said = run_program([sys.executable, "-c", "import sys; sys.exit('\x1b[31mno')"], ["{}"], 20.0).said

    assert said == "?[31mno"


def test_a_file_of_answers_may_have_so_many_bytes_and_no_more(tmp_path):
    with (tmp_path / "root-j.jsonl").open("wb") as file:
        file.write(ANSWERS.encode())
        file.truncate(1 << 32)

    assert "it has more than 24 MiB: " in described(*check_answers(tmp_path, [CASE], Asked()))


def test_answers_are_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "root-j.jsonl")

    assert "it is not a file: " in described(*check_answers(tmp_path, [CASE], Asked()))


def test_lines_are_numbered_as_in_an_editor():
    """From 1, blank ones too; a byte order mark is no text."""
    output = "\ufeff\n\r\n a\n\nb\x85c\r\n \nd".encode()

    assert list(Ended(output, "").lines()) == [(3, "a"), (5, "b\x85c\r"), (7, "d")]
