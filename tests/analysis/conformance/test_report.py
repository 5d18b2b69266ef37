"""The conformance kit for Python functions, and what its checks give back."""

import sys
from itertools import repeat
from pathlib import Path

import numpy as np
import pytest
from solidtouch.analysis.conformance.routes import answers as engine_answers

import solidtouch as st

ALL = ["log_likelihood", "log_evidence", "posterior", "where", "what", "decisions", "move"]
SHORT = ["root-j", "fit", "ties", "impossible-later", "shift-clamp"]


def right(case):
    yield from st.conformance.expected(case.name)


def changed(**values):
    """An implementation that gives these in place of the right values of its second answer."""

    def implementation(case):
        answers = st.conformance.expected(case.name)
        answers[1] |= values
        return answers

    return implementation


def one_more(case):
    answers = st.conformance.expected(case.name)
    return [*answers, answers[-1]]


def verdict(implementation, name="root-j"):
    return st.conformance.run(implementation, [name]).found[name]


def test_right_answers_pass():
    report = st.conformance.run(right, SHORT)

    assert report.passed
    assert [*report.found] == SHORT
    assert "5 of 5 cases pass." in repr(report)


def test_an_engine_is_an_implementation_too():
    """Its zero evidence is an answer."""

    def numpy(case):
        for answer in engine_answers("numpy", case):
            yield {**answer.values} if answer.error is None else {"error": answer.error}

    assert st.conformance.run(numpy, SHORT).passed


def test_lists_scalars_and_infinities_are_numbers():
    """As Python and NumPy have them, and as JSON."""

    def lists(case):
        for answer in st.conformance.expected(case.name):
            values = {name: value.tolist() if hasattr(value, "tolist") else value for name, value in answer.items()}
            yield values | {"move": np.int16(answer["move"]), "log_evidence": np.float64(answer["log_evidence"])}

    def objects(case):
        for answer in st.conformance.expected(case.name):
            no = [None if m < 0 else m for m in answer["decisions"]]
            yield answer | {"decisions": no, "posterior": tuple(map(tuple, answer["posterior"]))}

    assert st.conformance.run(lists, ["root-j", "prior-holes", "prior-certain"]).passed
    assert st.conformance.run(objects, ["root-j", "prior-holes", "thresholds"]).passed


def test_an_impossible_tap_may_raise():
    def raises(case):
        for answer in st.conformance.expected(case.name):
            if "error" in answer:
                raise st.ZeroEvidenceError
            yield answer

    assert st.conformance.run(raises, ["impossible-later", "impossible-tap"]).passed


def test_a_function_may_change_what_it_is_given():
    """Cases and answers of others stay as they are."""

    def spoils(case):
        answers = st.conformance.expected(case.name)
        case.prior[:] = 0
        case.taps[:] = 7
        answers[0]["posterior"][:] = 1
        yield from st.conformance.expected(case.name)

    (case,) = st.conformance.cases("prior-uneven")
    case.counts[:] = 0
    for _ in range(2):
        assert st.conformance.run(spoils, ["prior-uneven"]).passed
    assert st.conformance.run_engine("numpy", ["prior-uneven"]).passed


def test_a_mistake_is_found_and_named():
    """At its first tap, in every case that it spoils."""

    def unsigned(case):
        for answer in st.conformance.expected(case.name):
            yield answer | {"move": abs(answer["move"])}

    report = st.conformance.run(unsigned, ["root-j", "fixation-first", "move-never"])
    results = report.results

    assert not report.passed
    assert results["status"].sel(case="move-never") == "pass"
    assert results["status"].sel(case="fixation-first") == "differs"
    assert np.isnan(results["tap"].sel(case="move-never"))
    assert results["quantity"].sel(case="fixation-first") == "move"
    assert report.found["fixation-first"].tap == results["tap"].sel(case="fixation-first")
    assert "fixation-first" in repr(report)
    assert "move-never" not in repr(report)
    assert "<table" in report._repr_html_()


@pytest.mark.parametrize(
    ("implementation", "sentence"),
    [
        (lambda _: None, "it returns NoneType, where an answer to each tap is due"),
        (lambda _: [3], "it gives an answer to tap 1 that is not a mapping: '3'"),
        (changed(posterior=[[np.nan] * 3] * 5), "it gives an answer to tap 2 that has NaN in posterior after 1 answer"),
        (changed(what=np.full(3, np.nan, "f4")), "it gives an answer to tap 2 that has NaN in what after 1 answer"),
        (changed(where=[1, 2]), "it gives an answer to tap 2 that has where of shape [2], [5] is due"),
        (changed(move="up"), "it gives an answer to tap 2 that has move 'up', which is text, not a whole number"),
        (changed(move=object), "which is not a whole number"),
        (one_more, "it gives more answers than taps, another to tap 4 after 4 answers"),
        (changed(tap=4), "it answers tap 4, where tap 2 is due after 1 answer"),
        (changed(case="other"), "it gives an answer to tap 2 that is about case 'other' instead of"),
        (lambda case: [*right(case)][:2], "there is no answer"),
        (lambda case: repeat({} | st.conformance.expected(case.name)[0] | {"tap": 1}), "answers tap 1, where tap 2"),
    ],
)
def test_what_is_no_answer_is_a_sentence(implementation, sentence):
    found = verdict(implementation)

    assert found.status in ("failed", "differs")
    assert sentence in found.sentence


def test_answers_without_end_are_not_waited_for():
    def endless(case):
        answers = st.conformance.expected(case.name)
        yield from answers
        while True:
            yield {name: value for name, value in answers[-1].items() if name != "tap"}

    assert verdict(endless).sentence == "there is an answer where none is due"


def test_an_exception_is_kept_with_its_traceback():
    def fails(case):
        yield st.conformance.expected(case.name)[0]
        raise ArithmeticError("too\nlarge")

    found = verdict(fails)

    assert found.sentence.startswith("it raises ArithmeticError('too")
    assert "after 1 answer" in found.sentence
    assert isinstance(found.error, ArithmeticError)
    assert found.error.__traceback__ is not None


def test_ctrl_c_is_no_failure_of_the_function():
    def interrupted(case):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        verdict(interrupted)


def test_quantities_may_be_left_out():
    def short(case):
        for answer in st.conformance.expected(case.name):
            del answer["log_evidence"]
            yield answer

    assert not st.conformance.run(short, ["root-j"]).passed
    assert st.conformance.run(short, ["root-j"], without=["log_evidence"]).passed
    assert st.conformance.run(right, ["root-j"], without=ALL[1:]).passed


def test_causes_are_looked_for_unless_unwanted():
    def wrong(case):
        return (answer | {"move": -answer["move"]} for answer in st.conformance.expected(case.name))

    causes = [st.conformance.run(wrong, ["root-j"], causes=wanted).found["root-j"].cause for wanted in (True, False)]

    assert causes == ["move-sign", ""]


def test_single_precision_has_wider_tolerances():
    def narrow(case):
        for answer in st.conformance.expected(case.name):
            yield answer | {"posterior": np.float32(answer["posterior"])}

    assert not st.conformance.run(narrow, ["root-j"]).passed
    assert st.conformance.run(narrow, ["root-j"], precision="single").passed


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: st.conformance.cases("y"), "case y: there is no such case"),
        (lambda: st.conformance.run(right, ["y"]), "case y: there is no such case"),
        (lambda: st.conformance.run(right, levels=["all"]), "level all: it must be one of core, episodes, borders"),
        (lambda: st.conformance.run(right, without=["belief"]), "without must be one of log_likelihood"),
        (lambda: st.conformance.run(right, without=ALL), "at least one quantity must be compared"),
        (lambda: st.conformance.run_program("true", without=ALL), "at least one quantity must be compared"),
        (lambda: st.conformance.run_files(".", without=ALL), "at least one quantity must be compared"),
        (lambda: st.conformance.run(right, without="belief"), "without must be a list, got 'belief'"),
        (lambda: st.conformance.run(right, 3), "names must be a list, got 3"),
        (lambda: st.conformance.cases(["root-j"]), r"case \['root-j'\]: there is no such case"),
        (lambda: st.conformance.run("right"), "implementation must be a function of a case, got 'right'"),
        (lambda: st.conformance.run_program(right), "command must be a text, a path or a list of them, got <function"),
        (lambda: st.conformance.export("/no/such", precision="half"), "precision half: it must be one of double, sin"),
        (lambda: st.conformance.run_program([]), "command is empty"),
        (lambda: st.conformance.run(right, precision="half"), "precision half: it must be one of double, single"),
        (lambda: st.conformance.run_engine("gpu"), "engine gpu: it must be one of numpy, numpyro, montecarlo"),
        (lambda: st.conformance.run_files("/no/such"), "answers /no/such: not a folder"),
    ],
)
def test_what_is_not_there_is_refused(call, sentence):
    with pytest.raises(st.InputError, match=sentence):
        call()


def test_a_program_is_named_by_its_words_too():
    words = [Path(sys.executable), "-c", "print(1)"]

    assert not st.conformance.run_program(words, ["root-j"]).passed
