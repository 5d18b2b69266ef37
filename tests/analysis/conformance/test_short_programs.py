"""The programs in Rust and Octave in docs/reference/conformance pass the cases of the kit."""

import sys

import pytest
from foreign_programs import FOLDER, SHORT_PROGRAMS, lines_of, play, random_case
from solidtouch.analysis.conformance.case import BASIC
from solidtouch.analysis.conformance.front import run_program


@pytest.fixture(scope="module", params=SHORT_PROGRAMS)
def short_program(request, tmp_path_factory):
    """The command of each program."""
    return SHORT_PROGRAMS[request.param](tmp_path_factory.mktemp("short") / "solid")


@pytest.mark.parametrize(
    "names",
    [
        ["fit", "bins-beside-edges", "one-taxel", "episode-clamp-holes", "episode-circular-holes", "impossible-later"],
        pytest.param([], marks=pytest.mark.slow),
    ],
    ids=["some", "all"],
)
def test_short_programs_pass_the_cases(short_program, names):
    """Of the kit, in one run of the program."""
    report = run_program([str(word) for word in short_program], names, together=True)

    assert report.passed, report.lines(passed=False)


@pytest.mark.parametrize("wrong", [{"format": 2}, {"saturation": 2.5}, {"prior": [[1.0]]}], ids="-".join)
def test_short_programs_refuse_what_they_cannot_do(short_program, wrong):
    """With a sentence that names the key."""
    case, taps = random_case("wrong")
    done = play(short_program, lines_of([({**case, **wrong}, taps)]))

    assert (done.returncode != 0, done.stdout) == (True, "")
    assert f'"{next(iter(wrong))}"' in done.stderr


@pytest.mark.parametrize(
    "levels", [["continuous", "strategies"], pytest.param([*BASIC], marks=pytest.mark.slow)], ids=["asked", "basic"]
)
def test_python_without_libraries_passes_all_levels(levels):
    """Those that are asked for by name as well."""
    words = [sys.executable, "-I", str(FOLDER / "solid.py")]
    report = run_program(words, levels=levels, together=True)

    assert report.passed, report.lines(passed=False)
    assert [*report.levels] == levels


@pytest.mark.parametrize("extension", ["rs", "m", "py"])
def test_short_programs_are_short(extension):
    """Under 200 lines, none longer than those of the other files here."""
    lines = (FOLDER / f"solid.{extension}").read_text(encoding="utf-8").splitlines()

    assert len(lines) < 200
    assert max(map(len, lines)) <= 120
