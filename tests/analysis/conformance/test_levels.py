"""Levels of the kit, what a program may claim, and reports for other programs."""

import json
import re
import sys
import time
from collections import Counter
from dataclasses import replace
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from foreign_programs import FOLDER
from solidtouch.analysis.conformance.case import BASIC, LEVELS
from solidtouch.analysis.conformance.catalogue import catalogue, own_kit
from solidtouch.analysis.conformance.dataset.version import KIT_VERSION
from solidtouch.analysis.conformance.report import ConformanceReport
from solidtouch.analysis.conformance.run import Asked, check_program
from solidtouch.analysis.conformance.verdict import Verdict

import solidtouch as st

SIZES = Counter(case.level for case in catalogue().values())


def report(wrong=(), names=None, **how):
    """A report on a program that gives these verdicts, and passes all else."""
    names = catalogue() if names is None else names
    found = {name: Verdict(name, "pass") for name in names} | {verdict.case: verdict for verdict in wrong}
    return ConformanceReport("Conformance of it", found, own_kit(), **how)


def claim(*args, **how):
    return report(*args, **how).sentences[-1]


def test_every_case_belongs_to_a_level():
    """Core has border uniform and every class trained, episodes every equation, borders all else of Eq. 9."""
    of_level = {level: [case for case in catalogue().values() if case.level == level] for level in LEVELS}

    assert sum(map(len, of_level.values())) == len(catalogue())
    assert all(of_level.values())
    assert {case.border for case in of_level["core"] + of_level["episodes"]} == {"uniform"}
    assert {case.border for case in of_level["borders"]} == {"uniform", "uniform_what", "prior", "clamp", "circular"}
    assert {case.equations for case in of_level["episodes"]} == {tuple(range(1, 11))}
    assert set().union(*(case.equations for case in of_level["core"])) == set(range(1, 11))
    assert "ten-thousand-taps" in {case.name for case in of_level["limits"]}
    assert {case.name for case in of_level["borders"] if case.border == "uniform"} == {
        "shift-uniform-holes",
        "episode-uniform-holes",
    }


def test_the_page_names_each_level():
    page = (FOLDER / "README.md").read_text(encoding="utf-8").partition("## Levels")[2].partition("## ")[0]

    assert re.findall(r"^\| `(\w+)` \|", page, flags=re.MULTILINE) == [*LEVELS]


def test_cases_are_chosen_by_level_and_by_name():
    assert [case.level for case in st.conformance.cases(levels=["limits"])] == ["limits"] * SIZES["limits"]
    assert [case.name for case in st.conformance.cases("root-j", "ties")] == ["root-j", "ties"]
    chosen = [case.name for case in st.conformance.cases("episode-long", "root-j", levels=["episodes"])]

    assert chosen[:2] == ["episode-long", "root-j"]
    assert len(chosen) == len(set(chosen)) == SIZES["episodes"] + 1


def test_a_text_is_no_list_of_cases_or_levels():
    with pytest.raises(st.InputError, match="levels must be a list, got 'core'"):
        st.conformance.cases(levels="core")
    with pytest.raises(st.InputError, match="names must be a list, got 'root-j'"):
        st.conformance.run(st.conformance.expected, "root-j")


def test_a_check_asks_for_the_levels_of_the_first_kit():
    """Others change what a header holds, so a program is asked for them by name; engines are asked for all."""
    asked = st.conformance.run(lambda case: st.conformance.expected(case.name)).found

    assert {catalogue()[name].level for name in asked} == set(BASIC)
    assert len(asked) == sum(case.level in BASIC for case in catalogue().values())
    assert st.conformance.run(lambda case: st.conformance.expected(case.name), levels=["continuous"]).passed
    assert st.conformance.run_engine("numpy", levels=["continuous", "strategies"]).passed


def test_a_program_claims_the_levels_that_it_passes():
    assert claim() == f"Conformance kit {KIT_VERSION}: passes core, episodes, borders, limits, continuous, strategies."

    wrong = [Verdict("episode-long", "differs"), Verdict("episode-passive", "failed", "it crashed")]
    assert claim(wrong) == (
        f"Conformance kit {KIT_VERSION}: passes core, borders, limits, continuous, strategies; "
        f"episodes: 1 of {SIZES['episodes']} differs, 1 of {SIZES['episodes']} failed."
    )


def test_a_level_of_which_a_case_was_not_asked_is_not_claimed():
    rest = f"{SIZES['core'] - 2} of {SIZES['core']} not asked."

    assert claim(names=["root-j", "ties"]) == f"Conformance kit {KIT_VERSION}: core: {rest}"
    assert claim([Verdict("ties", "differs")], names=["root-j"]).endswith(f"core: 1 of 2 differs, {rest}")


def test_a_claim_names_its_conditions():
    left = [Verdict("ten-thousand-taps", "left out", "32 bits cannot do it")]
    assert claim(left, precision="single", without=("log_evidence",)) == (
        f"Conformance kit {KIT_VERSION}, single precision, no log_evidence: passes core, episodes, borders, "
        "limits (1 left out), continuous, strategies."
    )
    assert claim(left, names=[]).endswith(f"limits: {SIZES['limits'] - 1} of {SIZES['limits']} not asked.")


def test_results_of_levels_are_numbers():
    found = report([Verdict("episode-long", "differs")]).levels

    assert [*found] == [*LEVELS]
    assert found["episodes"]._asdict() == {
        "level": "episodes",
        "cases": SIZES["episodes"],
        "passed": SIZES["episodes"] - 1,
        "differs": 1,
        "failed": 0,
        "left_out": 0,
        "not_asked": 0,
    }
    assert [result.passes for result in found.values()] == [True, False, True, True, True, True]


WRONG = [
    Verdict("ties", "differs", "its move is +1 \x1b[31m\ud800\x00 <instead> & of +0", 2, "move", "move-sign"),
    Verdict("root-jk", "failed", "it ended with exit code 1", seconds=0.25),
    Verdict("single-edges", "left out", "32 bits cannot do it"),
    Verdict("root-none", "pass", "it left a process running, which was stopped", seconds=1.0004),
]


def test_a_check_knows_how_long_each_case_took():
    """Of a program that is started for each, and of a function; not where one start answers all."""
    cases = own_kit().select(["root-j", "ties"])
    sleep = [sys.executable, "-c", "import time; time.sleep(0.2)"]
    alone, together = (list(check_program(sleep, cases, Asked(), how)) for how in (False, True))
    function = st.conformance.run(lambda _: time.sleep(0.2), ["root-j"]).found["root-j"]

    assert all(0.2 < verdict.seconds < 60 for verdict in (*alone, function))
    assert [verdict.seconds for verdict in together] == [None, None]


def test_a_report_is_json():
    text = report(WRONG).as_json()
    found = json.loads(text)
    ties = next(case for case in found["cases"] if case["case"] == "ties")

    assert text.isascii()
    assert (found["kit"], found["passed"], len(found["cases"])) == (KIT_VERSION, False, len(catalogue()))
    assert ties == {
        "case": "ties",
        "level": "core",
        "about": catalogue()["ties"].about,
        "status": "differs",
        "tap": 2,
        "quantity": "move",
        "sentence": WRONG[0].sentence,
        "cause": "move-sign",
        "about_cause": "the move has the wrong sign",
    }
    assert found["sentences"] == report(WRONG).sentences
    assert [level["passes"] for level in found["levels"]] == [False, True, True, True, True, True]


def test_a_report_is_junit():
    """One suite for each level, counts that add up, and texts without what XML cannot hold."""
    root = ET.fromstring(report(WRONG).as_junit().encode())  # noqa: S314 - it was written here
    tests = {test.get("name"): test for test in root.iter("testcase")}
    text = "tap 2: its move is +1 ?[31m?? <instead> & of +0"

    assert [suite.get("name") for suite in root] == [*LEVELS]
    assert [root.get(name) for name in ("tests", "failures", "errors", "skipped")] == [
        str(len(catalogue())),
        "1",
        "1",
        "1",
    ]
    for name in ("tests", "failures", "errors", "skipped"):
        assert int(root.get(name)) == sum(int(suite.get(name)) for suite in root)
    assert [*tests] == [case for level in LEVELS for case in catalogue() if catalogue()[case].level == level]
    assert tests["ties"].find("failure").get("message") == text
    about = {name: f"\nwhat it tests: {case.about}" for name, case in catalogue().items()}
    assert tests["ties"].find("failure").text == f"{text}\nlikely cause: the move has the wrong sign{about['ties']}"
    assert tests["root-jk"].find("error").text == f"it ended with exit code 1{about['root-jk']}"
    assert tests["single-edges"].find("skipped").get("message") == "32 bits cannot do it"
    assert tests["root-none"].find("system-out").text == "it left a process running, which was stopped"
    assert len(tests["root-j"]) == 0
    assert [tests[name].get("time") for name in ("root-j", "root-jk", "root-none")] == [None, "0.250", "1.000"]
    assert [suite.get("time") for suite in (root, *root)] == ["1.250", "1.250", *[None] * (len(LEVELS) - 1)]
    assert {e.get("value") for e in root.iter("property") if e.get("name") == "kit"} == {KIT_VERSION}


def test_junit_names_the_conditions_and_the_claim():
    """As the text does; a level that the program cannot claim says so."""
    without = replace(report(WRONG), precision="single", without=("log_evidence", "where"))
    root, plain = (ET.fromstring(one.as_junit().encode()) for one in (without, report(WRONG)))  # noqa: S314
    found = [{each.get("name"): each.get("value") for each in suite.iter("property")} for suite in root]

    for suite, level in zip(found, LEVELS, strict=True):
        assert {name: suite[name] for name in ("precision", "without", "passes", "claim")} == {
            "precision": "single",
            "without": "log_evidence where",
            "passes": "false" if level == "core" else "true",
            "claim": without.sentences[-1],
        }
    assert "single precision, no log_evidence, no where: passes" in found[0]["claim"]
    assert not [each for each in plain.iter("property") if each.get("name") == "without"]


def test_the_words_of_a_program_do_not_end_in_xml_or_json():
    """Whatever they are; what was checked is named by its words, too."""
    odd = replace(report(WRONG), title="Conformance of \x07\"&<'\udfff")

    assert ET.fromstring(odd.as_junit().encode()).get("name") == "Conformance of ?\"&<'?"  # noqa: S314
    assert json.loads(odd.as_json())["title"] == odd.title


@pytest.mark.parametrize("name", ["root-j", "ties"])
def test_a_report_of_a_check_holds_its_levels(name):
    found = st.conformance.run(lambda case: st.conformance.expected(case.name), [name])

    assert found.passed
    assert found.levels["core"].not_asked == found.levels["core"].cases - 1


def test_rounding_may_favour_any_move_where_none_tells_anything():
    """As in plain arithmetic the only tap that can come has the sum of all beliefs, 1 but for rounding."""

    def rounded(case):
        for answer in st.conformance.expected(case.name):
            told = np.zeros(len(answer["where"]))
            told[3] = 2.2e-16
            yield answer | {"information": told, "move": 3 - int(answer["where"].argmax())}

    assert st.conformance.run(rounded, ["info-pool-of-one"]).passed
