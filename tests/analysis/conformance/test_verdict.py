"""What the kit makes of right, wrong and broken output."""

import json
import sys
from dataclasses import replace

import numpy as np
import pytest
from solidtouch.analysis.conformance import run
from solidtouch.analysis.conformance.answers import QUANTITIES, Answer
from solidtouch.analysis.conformance.case import to_line
from solidtouch.analysis.conformance.catalogue import catalogue, expected
from solidtouch.analysis.conformance.causes import with_causes
from solidtouch.analysis.conformance.mistakes import MISTAKES
from solidtouch.analysis.conformance.program import Ended
from solidtouch.analysis.conformance.run import Asked, check_answers, check_program
from solidtouch.analysis.conformance.verdict import described, judge, judge_output, summary

CASE = catalogue()["episode-clamp"]
FIT = catalogue()["fit"]
IMPOSSIBLE = catalogue()["impossible-later"]


def output(case, answers=None):
    return "".join(f"{to_line(answer.line(case.name))}\n" for answer in (answers or expected(case)))


def wrote(text):
    """The end of a program with this output."""
    return Ended(text.encode(), "")


def changed(case, tap, **values):
    """The right answers with other values at one tap."""
    return [replace(a, values={**a.values, **values}) if a.tap == tap else a for a in expected(case)]


def test_a_line_is_plain_json():
    """As short as can be, with names as they are written, and no number that JSON has not."""
    assert to_line({"näme": [1.5, 2]}) == '{"näme":[1.5,2]}'
    with pytest.raises(ValueError, match="not JSON compliant"):
        to_line({"belief": float("nan")})


@pytest.mark.parametrize("number", [1, 3])
def test_a_program_that_is_started_once_has_the_time_of_all_cases(monkeypatch, number):
    given = []
    monkeypatch.setattr(run, "run_program", lambda _, __, seconds: given.append(seconds) or wrote(""))
    list(check_program(["true"], [CASE, FIT, IMPOSSIBLE][:number], Asked(timeout=7.0), together=True))
    assert given == [7.0 * number]


@pytest.mark.parametrize("case", [CASE, FIT, IMPOSSIBLE], ids=lambda case: case.name)
def test_right_answers_pass(case):
    assert judge_output(case, wrote(output(case)), "double").status == "pass"


@pytest.mark.parametrize("name", [name for name in QUANTITIES if name not in ("edges", "counts", "decisions", "move")])
def test_a_number_outside_its_tolerance_is_found_at_its_tap(name):
    """And one inside passes."""
    case = catalogue()["info-what"] if name == "information" else CASE
    right = expected(case)[2].values[name]
    near = judge(case, changed(case, 3, **{name: right + 1e-12}), "double")
    far = judge(case, changed(case, 3, **{name: right + 1e-6}), "double")

    assert near.status == "pass"
    assert (far.status, far.tap, far.quantity) == ("differs", 3, name)
    assert "off by 1e-06" in far.sentence


def test_wider_tolerances_of_single_precision():
    answers = changed(CASE, 5, posterior=expected(CASE)[4].values["posterior"] + 1e-6)

    assert judge(CASE, answers, "single").status == "pass"


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"move": 17}, "its move is +17 instead of"),
        ({"decisions": np.array([0, 0])}, "at threshold 0.5 it decides 0 instead of"),
    ],
)
def test_a_wrong_choice_is_found(values, sentence):
    verdict = judge(CASE, changed(CASE, 2, **values), "double")

    assert verdict.tap == 2
    assert sentence in verdict.sentence


def test_wrong_counts_and_edges_of_a_fit_are_found():
    fitted = expected(FIT)[0].values
    for name in ("edges", "counts"):
        wrong = fitted[name].copy()
        wrong.flat[1] += 1
        verdict = judge(FIT, changed(FIT, 0, **{name: wrong}), "double")
        assert (verdict.tap, verdict.quantity) == (0, name)


def test_a_missing_quantity_differs_unless_it_is_let_go():
    answers = [replace(a, values={k: v for k, v in a.values.items() if k != "log_evidence"}) for a in expected(CASE)]

    assert judge(CASE, answers, "double").sentence == "log_evidence is missing"
    assert judge(CASE, answers, "double", without=("log_evidence",)).status == "pass"


def test_an_answer_to_an_impossible_tap_differs_and_so_does_an_error_without_reason():
    last = expected(IMPOSSIBLE)[-1].tap
    made_up = [*expected(IMPOSSIBLE)[:-1], replace(expected(IMPOSSIBLE)[0], tap=last)]

    assert "where zero_evidence is due" in judge(IMPOSSIBLE, made_up, "double").sentence
    assert "where an answer is due" in judge(CASE, [Answer(1, error="zero_evidence")], "double").sentence


def test_an_error_of_a_program_does_not_paint_on_a_terminal_nor_break_a_report():
    """As JSON can name half of a letter, which no text may hold."""
    text = json.dumps({"case": CASE.name, "tap": 1, "error": "\ud800\x1b[2J\n" + 1000 * "x"})
    sentence = judge_output(CASE, Ended(text.encode(), ""), "double").sentence

    assert sentence == f"it says ??[2J?{54 * 'x'} where an answer is due"


LINES = output(CASE).splitlines(keepends=True)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be"])
def test_output_in_utf_16_is_named_as_such(encoding):
    """As PowerShell's > writes it."""
    verdict = judge_output(CASE, Ended("".join(LINES).replace("\n", "\r\n").encode(encoding), ""), "double")

    assert verdict.sentence == "it writes line 1, which is UTF-16, not UTF-8"


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "there is no answer"),
        ("".join(LINES[:-1]), "there is no answer"),
        ("hello\n", "writes line 1, which is not JSON: 'hello'"),
        ("".join(LINES[:3]) + "[1]\n", "writes line 4, which is not a JSON object: '[1]' after 3 answers"),
        ("".join(LINES[:2]) + "".join(LINES[3:]), "answers tap 4 in line 3, where tap 3 is due"),
        (
            "".join([*LINES, LINES[-1]]),
            "it gives more answers than taps, another to tap 12 in line 13 after 12 answers",
        ),
        (LINES[0] + LINES[0], "answers tap 1 in line 2, where tap 2 is due"),
        (LINES[0].replace("episode-clamp", "other"), "is about case 'other' instead of 'episode-clamp'"),
        (LINES[0].replace('"case"', '"name"'), "does not name its case, 'episode-clamp'"),
        ('{\n "case": 1}', "writes line 1, which ends within an object, which must be on one line: '{'"),
        (LINES[0].replace('"tap":1', '"tap":"one"'), "has tap 'one', which is text, not a whole number"),
        (LINES[0].replace('"tap":1', '"tip":1'), "has no tap number"),
        (LINES[0].replace('"move":', '"move":0.5,"x":'), "has move '0.5', which is not a whole number"),
        (LINES[0].replace('"move":', '"move":1e999,"x":'), "has move 'inf', which is not a whole number"),
        (LINES[0].replace('"where":[', '"where":[0.1,'), "has where of shape [6], [5] is due"),
        (LINES[0].replace('"where":[', '"where":["a",'), "has where"),
        (LINES[0].replace('"where":[', '"where":[null,'), "has where of shape"),
        (LINES[0].replace('"log_evidence":', '"log_evidence":NaN,"x":'), "is not JSON"),
        ("\x00\xff\n", "is not JSON"),
        ("".join(LINES) + LINES[-1].replace('"tap":12', '"tap":13'), "there is an answer where none is due"),
    ],
)
def test_broken_output_is_told_in_words(text, sentence):
    verdict = judge_output(CASE, wrote(text), "double")

    assert verdict.status in ("failed", "differs")
    assert sentence in described(verdict)


@pytest.mark.parametrize(
    "text",
    [
        output(CASE).replace("\n", "\r\n"),
        output(CASE).replace("\n", "\n \t\n") + "\n",
        "\ufeff" + output(CASE),
        output(CASE).replace("{", '{"note":"a\u2028b\x85","error":null,', 1),
    ],
    ids=["Windows", "blank lines", "byte order mark", "line separators in a string"],
)
def test_the_layout_of_lines_does_not_matter(text):
    """Nor do keys that nobody asked for."""
    assert judge_output(CASE, wrote(text), "double").status == "pass"


@pytest.mark.parametrize("line", ["[" * 200_000, LINES[0].replace('"move":', f'"x":{"[" * 100_000},"move":')])
def test_lists_within_lists_without_end_are_no_crash(line):
    assert "is not JSON" in described(judge_output(CASE, wrote(line), "double"))


def test_what_is_no_number_is_shown():
    line = LINES[0].replace('"log_evidence":', '"log_evidence":NaN,"x":')

    assert "is not JSON, which has no NaN" in described(judge_output(CASE, wrote(line), "double"))
    line = line.replace("NaN", "nan")
    assert "is not JSON from character " in described(judge_output(CASE, wrote(line), "double"))
    assert "on: 'nan," in described(judge_output(CASE, wrote(line), "double"))


def test_underflow_is_no_cause_of_what_is_no_number_where_nothing_underflows():
    """NaN from elsewhere has no likely cause."""
    deep = catalogue()["tap-underflows"]
    broken = [judge_output(case, wrote('{"x": nan}'), "double") for case in (CASE, deep)]

    assert [verdict.cause for verdict in broken] == ["", "linear-likelihood"]


def test_an_answer_of_every_type_of_json_is_no_crash():
    """Every value of a right line in turn is replaced by others."""
    right = json.loads(LINES[0])
    for key in right:
        for value in (None, True, -1, 0.5, "x", [], [None], [[]], {}, [[1, 2], [3]], 10**400):
            line = json.dumps(right | {key: value})
            assert judge_output(CASE, wrote(line), "double").status in ("failed", "differs")


ECHO = """
import json, sys
answers = json.load(open(sys.argv[1]))
for line in sys.stdin:
    fields = json.loads(line)
    if "format" in fields:
        case = fields["case"]
        print("".join(answers[case]), end="", flush=True)
        if case == "root-jk" and len(sys.argv) > 2:
            sys.exit(4)
"""


@pytest.mark.parametrize("together", [False, True])
def test_a_program_may_be_started_for_each_case_or_for_all(together, tmp_path):
    """One that dies in the third case has passed the first two."""
    cases = [catalogue()[name] for name in ("root-j", "fit", "root-jk", "root-none")]
    (tmp_path / "answers.json").write_text(json.dumps({case.name: output(case) for case in cases}))
    words = [sys.executable, "-c", ECHO, str(tmp_path / "answers.json")]
    well = list(check_program(words, cases, Asked(), together))
    dead = list(check_program([*words, "die"], cases, Asked(), together))

    assert [verdict.status for verdict in well] == ["pass"] * 4
    assert [verdict.status for verdict in dead] == ["pass", "pass", "failed", "failed" if together else "pass"]
    assert "exit code 4" in dead[2].sentence


LAST = ECHO.replace('"".join(answers[case])', '"".join(json.dumps(a) + "\\n" for a in answers[case])').replace(
    "sys.exit(4)", "import time; time.sleep(60)"
)


def test_verdicts_before_a_program_hangs_are_kept(tmp_path):
    """Also if the name of the case stands last in each answer, and the case before is the last that was answered."""
    cases = [catalogue()[name] for name in ("root-j", "fit", "root-jk", "root-none")]
    lines = {case.name: [json.loads(line) for line in output(case).splitlines()] for case in cases}
    turned = {name: [dict(reversed(line.items())) for line in answers] for name, answers in lines.items()}
    (tmp_path / "answers.json").write_text(json.dumps(turned))
    words = [sys.executable, "-c", LAST, str(tmp_path / "answers.json"), "hang"]
    found = list(check_program(words, cases, Asked(timeout=0.5), together=True))

    assert [verdict.status for verdict in found] == ["pass", "pass", "pass", "failed"]
    assert "was stopped" in found[3].sentence


def test_answers_in_files_are_judged(tmp_path):
    (tmp_path / "fit.jsonl").write_text(output(FIT))
    verdicts = list(check_answers(tmp_path, [FIT, CASE], Asked()))

    assert [verdict.status for verdict in verdicts] == ["pass", "failed"]
    assert "No such file" in described(verdicts[1])


def test_the_cause_that_explains_most_is_named_last():
    """A mistake in every case is told once with the number of cases."""
    names = ("root-j", "root-jk", "episode-clamp")
    answers = {}
    for name in names:
        answers[name] = [
            replace(a, values={**a.values, "move": -a.values["move"]}) if a.error is None else a
            for a in expected(catalogue()[name])
        ]
    verdicts = with_causes([judge(catalogue()[name], answers[name], "double") for name in names], catalogue(), "double")
    lines, fine = summary(verdicts)

    assert not fine
    assert lines == ["Likely cause in 3 of 3: the move has the wrong sign (move-sign).", "0 of 3 cases pass, 3 differ."]


def test_a_mistake_with_which_other_cases_would_fail_is_no_cause():
    """A program that never moves looks in one case as if it counted from 1; in another it does not."""
    wrong, right = catalogue()["root-j"], catalogue()["move-undone"]
    still = [replace(a, values={**a.values, "move": 0}) for a in expected(wrong)]
    alone = with_causes([judge(wrong, still, "double")], catalogue(), "double")
    both = with_causes([judge(wrong, still, "double"), judge(right, expected(right), "double")], catalogue(), "double")

    assert [verdict.cause for verdict in alone] == ["one-based"]
    assert [verdict.cause for verdict in both] == ["", ""]


@pytest.mark.parametrize("more", [0, 1e-6 / 3])
@pytest.mark.parametrize(("form", "digits"), [(".6g", "6 significant digits"), (".4f", "4 decimals")])
def test_rounded_numbers_are_named_with_their_digits(form, digits, more):
    """In each case; one number of all that is not rounded refutes it."""
    cases = [catalogue()[name] for name in ("root-j", "prior-uneven", "episode-clamp", "episode-uniform")]
    answers = [
        [replace(a, values={k: _rounded(v, form) for k, v in a.values.items()}) for a in expected(c)] for c in cases
    ]
    answers[2][0].values["log_likelihood"].flat[-1] += more
    found = with_causes([judge(*pair, "double") for pair in zip(cases, answers, strict=True)], catalogue(), "double")

    about = "" if more else f"numbers are rounded to {digits}, where 17 digits are due"
    assert [(verdict.quantity, verdict.about) for verdict in found] == [("log_likelihood", about)] * 4


def _rounded(value, form):
    """Numbers as a program prints them."""
    return np.vectorize(lambda x: float(format(x, form)))(value) if np.asarray(value).dtype.kind == "f" else value


def test_what_no_mistake_explains_has_no_cause():
    answers = changed(CASE, 3, log_evidence=123.0)
    verdict = with_causes([judge(CASE, answers, "double")], catalogue(), "double")[0]

    assert verdict.cause == ""
    assert described(verdict).startswith("DIFFERS tap 3: log_evidence is 123 instead of")


@pytest.mark.parametrize("name", ["one-place", "one-object", "one-of-all"])
def test_arrays_may_be_written_as_matlab_writes_them(name):
    """Columns as lists in a list, lists of one as numbers, and whole numbers with a point."""
    case = catalogue()[name]
    lines = []
    for answer in expected(case):
        line = answer.line(case.name)
        for key in ("log_likelihood", "posterior", "log_posterior", "where", "what"):
            squeezed = np.squeeze(np.array(line[key], dtype=object))
            line[key] = squeezed.tolist()
        lines.append(to_line(line | {"tap": float(answer.tap), "move": float(line["move"])}))

    assert judge_output(case, wrote("\n".join(lines)), "double").status == "pass"


def named(mistake, form, names, silent=()):
    """Causes of the cases that differ where a program makes a form of a mistake and leaves some quantities out."""
    rules = next(known for known in MISTAKES if known.name == mistake).rules[form]
    cases = {name: catalogue()[name] for name in names}
    judged = [
        judge(case, [answer.without(silent) for answer in rules(case).answers()], "double") for case in cases.values()
    ]
    return [verdict.cause for verdict in with_causes(judged, cases, "double") if verdict.status != "pass"]


def test_what_a_program_does_not_answer_refutes_no_cause():
    """A passing case would fail by its `log_posterior` alone."""
    assert named("log10", 0, ["root-j", "one-bin"], ["log_posterior"]) == ["log10"]


@pytest.mark.parametrize("form", range(3))
def test_a_threshold_that_is_reached_by_decision_or_move_alone_is_named(form):
    found = named("greater-or-equal", form, ["prior-certain", "move-never", "thresholds"])

    assert set(found) == {"greater-or-equal"}
