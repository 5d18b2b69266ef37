"""The programs in docs/reference/conformance agree with the reference equations and refuse what they cannot read."""

import json
import shutil
import subprocess

import numpy as np
import pytest
from foreign_programs import (
    FOLDER,
    STRICT,
    compile_c,
    differs,
    expected,
    header,
    lines_of,
    play,
    random_case,
    tap_lines,
    wrong_keys,
)
from slow_cases import slow_but


def test_programs_agree_with_the_reference(program, kit):
    """On all borders, powers, sizes of one, certainty, zero evidence and training, in one run."""
    text, right = kit

    assert wrong_keys(play(program, text), right) == []


def test_programs_agree_on_a_long_sequence(program, long_kit):
    """Of 3000 taps."""
    text, right = long_kit

    assert wrong_keys(play(program, text), right) == []


def test_the_cases_hold_what_they_are_for(kit, long_kit):
    """Impossible taps, improbable classes that come back, decisions made and not, moves both ways."""
    (_, right), (_, long) = kit, long_kit

    assert sum("error" in r for r in right) == 1
    assert min(r["log_posterior"].min() for r in long) < -2000
    assert (long[1399]["what"][0] > 0.999, long[-1]["what"][1] > 0.999) == (True, True)
    assert {type(d) for r in right for d in r.get("decisions", [])} == {int, type(None)}
    assert {np.sign(r.get("move", 0)) for r in right} == {-1, 0, 1}


@pytest.mark.parametrize("options", [["-O1", "-g", "-fsanitize=address,undefined"]])
def test_the_c_program_behaves_as_defined(options, kit, tmp_path):
    """Sanitizers find nothing, on good and on bad input."""
    probe = tmp_path / "probe.c"
    probe.write_text("int main(void) { return 0; }\n")
    compiler = shutil.which("cc") or shutil.which("gcc")
    if not compiler or subprocess.run([compiler, *options, "-o", tmp_path / "probe", probe], check=False).returncode:
        pytest.skip("there is no C compiler with sanitizers")
    command = compile_c(FOLDER / "solid.c", tmp_path / "solid", *options)

    done = play(command, kit[0])
    assert (done.returncode, done.stderr) == (0, "")
    for text in BAD_INPUTS.values():
        done = play(command, text)
        assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr


def test_the_c_program_can_compute_in_single_precision(kit, tmp_path):
    """Then it agrees to single precision, but for taps that are impossible or nearly so."""
    command = compile_c(FOLDER / "solid.c", tmp_path / "solid", "-DSOLIDTOUCH_REAL=float", *STRICT)
    answers = [json.loads(line) for line in play(command, kit[0]).stdout.splitlines()]
    pairs = [(a["posterior"], r["posterior"]) for a, r in zip(answers, kit[1], strict=True) if "posterior" in r]

    assert max(np.abs(np.array(a) - r).max() for a, r in pairs) < 1e-3
    assert max(np.abs(np.array(a) - r).max() for a, r in pairs) > 1e-9


# Bad input
def bad_inputs():
    """Text of cases in each of which one thing is wrong."""
    case, taps = random_case("bad")
    header, first, second = json.dumps(case), json.dumps(taps[0]), json.dumps(taps[1])
    training = {"taps": [[[1.0, 2.0]] * 5], "where": [0], "what": [0]}
    without_counts = {key: value for key, value in case.items() if key not in ("counts", "edges")}
    changed = {
        "format": {**case, "format": 2},
        "border": {**case, "border": "periodic"},
        "power": {**case, "power": "L"},
        "prior": {**case, "prior": [[0.5] * 3] * 4},
        "counts": {**case, "counts": case["counts"][1:]},
        "negative": {**case, "counts": (-np.array(case["counts"])).tolist()},
        "edges": {**case, "edges": [0, 1, 2, 2, 3, 4, 5]},
        "fixation": {**case, "fixation": 4},
        "L": {**case, "L": 0},
        "huge": {**case, "L": 10**6, "M": 10**6},
        "saturation": {**case, "saturation": 2.5},
        "infinite": {**case, "theta_x": float("inf")},
        "null": {**case, "theta_x": None},
        "missing": {key: value for key, value in case.items() if key != "thresholds"},
        "both": {**case, "training": training},
        "neither": without_counts,
        "class": {**without_counts, "training": {**training, "what": [3]}},
        "equal": {**without_counts, "training": {**training, "taps": [[[1.0, 1.0]] * 5]}},
        "empty": {**case, "counts": np.zeros((4, 3, 2, 6)).tolist(), "pseudocount": 0},
        "text": {**case, "thresholds": "0.5"},
        "list": {**case, "training": [], "counts": None},
    }
    return {
        **{name: f"{json.dumps(value)}\n{first}\n" for name, value in changed.items()},
        "samples": f"{header}\n{json.dumps({**taps[0], 'samples': [[1]]})}\n",
        "word": f"{header}\n{first.replace('[[', '[[nan,')}\n",
        "hexadecimal": header.replace('"theta_x": 0.0', '"theta_x": 0x10') + "\n",
        "half": f"{header}\n{first[: len(first) // 2]}\n",
        "string": '{"case": "x\\',
        "deep": f'{{"tap": {"[" * 100000}',
        "two": f"{header}\n{first} {second}\n",
        "order": f"{header}\n{second}\n",
        "headless": f"{first}\n",
        "no JSON": "tap 1\n",
        "number": "7\n",
        "move": f"{header}\n{json.dumps({**taps[0], 'move': 0.5})}\n",
    }


BAD_INPUTS = bad_inputs()


@pytest.fixture(scope="module")
def refused():
    """A function that plays a bad input once for all tests that ask what a program says to it."""
    done = {}

    def refuse(program, name):
        key = str(program[0]), name
        if key not in done:
            done[key] = play(program, BAD_INPUTS[name])
        return done[key]

    return refuse


ASKED = [(program, name) for program in ("c", "js") for name in BAD_INPUTS]
IN_TURN = [(("c", "js")[i % 2], name) for i, name in enumerate(BAD_INPUTS)]
"""Each bad input once, by one program and by the other."""


@pytest.mark.parametrize(("program", "name"), slow_but(IN_TURN, ASKED), indirect=["program"])
def test_bad_input_is_refused_with_a_sentence(program, refused, name):
    """It names the line, and the exit code is 2."""
    done = refused(program, name)

    assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
    assert done.stderr.startswith("solid: line ")
    assert done.stderr.endswith(".\n")


@pytest.mark.parametrize("name", ["border", "power", "prior", "counts", "edges", "fixation", "samples", "move"])
def test_the_sentence_names_case_line_and_key(program, refused, name):
    """So that the person who made the input finds it."""
    sentence = refused(program, name).stderr

    assert f'line {2 if name in ("samples", "move") else 1}, case "bad"' in sentence
    assert f'"{name}"' in sentence


def test_what_came_before_bad_input_is_answered(program):
    """The answers to earlier taps are written."""
    case, taps = random_case("good")
    done = play(program, lines_of([(case, taps)]) + "no JSON\n")

    assert (done.returncode, len(done.stdout.splitlines())) == (2, len(taps))


def test_layout_of_the_text_does_not_matter(program, kit):
    """Spaces, order of keys, further keys, empty lines, and a last line without end."""
    case, taps = random_case("good")
    spaced = [json.dumps(line, indent=1).replace("\n", " \t") for line in (dict(reversed(case.items())), *taps)]
    spaced[1] = spaced[1][:-1] + ', "note": {"a": [[], {}, "]}"], "b": null}}'

    assert play(program, "\r\n\n".join(spaced)).stdout == play(program, lines_of([(case, taps)])).stdout


def test_an_exported_model_without_saturation_is_read_as_a_case(program):
    """Its key is there and null."""
    case, taps = random_case("exported")

    assert wrong_keys(play(program, lines_of([({**case, "saturation": None}, taps)])), expected(case, taps)) == []


def test_a_long_line_is_read(program):
    """A header of some MB."""
    case, taps = random_case("long", sizes=(20, 5, 12, 3, 300), moves=(0, 1))

    assert wrong_keys(play(program, lines_of([(case, taps)])), expected(case, taps)) == []


# A model compiled in
MODEL_HEADER = """#include <math.h>
#define SOLIDTOUCH_FORMAT 1
#define SOLIDTOUCH_REAL double
#define SOLIDTOUCH_L 2
#define SOLIDTOUCH_M 2
#define SOLIDTOUCH_K 1
#define SOLIDTOUCH_J 2
#define SOLIDTOUCH_B 2
#define SOLIDTOUCH_EXPONENT 0.5
#define SOLIDTOUCH_BORDER "clamp"
#define SOLIDTOUCH_THETA_W 0.95
#define SOLIDTOUCH_THETA_X 0.0
#define SOLIDTOUCH_FIXATION 1
#define SOLIDTOUCH_SATURATION 0
static const SOLIDTOUCH_REAL solidtouch_edges[1][3] = {{0, 1, 2}};
static const SOLIDTOUCH_REAL solidtouch_log_prob[2][2][1][2] = {
  {{{-0.2876820724517809, -1.3862943611198906}}, {{0, -INFINITY}}},
  {{{-0.6931471805599453, -0.6931471805599453}}, {{-1.3862943611198906, -0.2876820724517809}}}};
static const SOLIDTOUCH_REAL solidtouch_log_prior[2][2] = {
  {-0.6931471805599453, -1.3862943611198906}, {-1.3862943611198906, -INFINITY}};
static const SOLIDTOUCH_REAL solidtouch_where_value[2] = {0, 1};
static const char *const solidtouch_what_name[2] = {"a", "b"};
"""


def test_a_compiled_in_model_answers_as_its_case(tmp_path):
    """Only taps are read; tap 1 begins a new sequence, also after an impossible one."""
    (tmp_path / "model.h").write_text(MODEL_HEADER)
    options = [f'-DMODEL_HEADER="{tmp_path / "model.h"}"', *STRICT]
    command = compile_c(FOLDER / "solid.c", tmp_path / "solid", *options)
    case = header(
        "model", 2, 2, 1, 2, 2, edges=[0, 1, 2], border="clamp", thresholds=[0.95], prior=[[0.5, 0.25], [0.25, 0]]
    )
    case["probabilities"] = [[[[0.75, 0.25]], [[1, 0]]], [[[0.5, 0.5]], [[0.25, 0.75]]]]
    taps = tap_lines((0, 1, -1), [[[0.5], [1]], [[0], [3]], [[0.2], [0.3]]])
    text = lines_of([(taps[0], taps[1:])])
    answers = [json.loads(line) for line in play(command, text + text).stdout.splitlines()]
    right = expected(case, taps)

    assert [differs(a, r) for a, r in zip(answers, right + right, strict=True)] == [set()] * 6
