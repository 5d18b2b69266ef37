"""The kit passes the foreign programs, and finds and names each usual mistake in them."""

import sys
from collections import Counter

import pytest
from foreign_programs import (
    ALL_MISTAKES,
    FOLDER,
    LEVEL_MISTAKES,
    MISTAKES,
    NAMES,
    compile_c,
    node,
    play,
    wrong_keys,
)
from slow_cases import slow_but
from solidtouch.analysis.conformance.case import BASIC
from solidtouch.analysis.conformance.catalogue import own_kit
from solidtouch.analysis.conformance.causes import with_causes
from solidtouch.analysis.conformance.mistakes import MISTAKES as KNOWN
from solidtouch.analysis.conformance.run import Asked, check_program


# Mistakes
def test_the_usual_mistakes_are_all_there():
    """In the order in which they are told."""
    assert [mistake["name"] for mistake in MISTAKES] == NAMES
    assert [mistake["name"] for mistake in ALL_MISTAKES] == [mistake.name for mistake in KNOWN]
    assert all(mistake["about"].endswith(".") for mistake in ALL_MISTAKES)


def mutant(mistake, language):
    text = (FOLDER / f"solid.{language}").read_text(encoding="utf-8")
    for find, replace in mistake[language]:
        assert text.count(find) == 1, find
        text = text.replace(find, replace)
    return text


@pytest.mark.slow
@pytest.mark.parametrize("mistake", MISTAKES, ids=NAMES)
def test_each_mistake_changes_answers_of_both_programs_alike(mistake, kit, long_kit, tmp_path):
    """The mutants run to the end, some answers are wrong, and they are the same ones."""
    for language in ("c", "js"):
        (tmp_path / f"solid.{language}").write_text(mutant(mistake, language), encoding="utf-8")
    in_c = compile_c(tmp_path / "solid.c", tmp_path / "solid", "-std=c99")
    text, right = long_kit if mistake["name"] == "linear-underflow" else kit

    wrong = wrong_keys(play(in_c, text), right)
    assert wrong
    assert wrong == wrong_keys(play([*node(), str(tmp_path / "solid.js")], text), right)


# The kit
SHORT = (
    "root-j",
    "bins-on-edges",
    "bins-outside",
    "empty-bins",
    "fit",
    "prior-uneven",
    "thresholds",
    "one-object",
    "marginals-not-joint",
    "shift-uniform",
    "shift-clamp",
    "shift-uniform-holes",
    "episode-uniform",
    "episode-other-moves",
    "ties",
    "one-taxel",
)
"""Cases with which each mistake is found in a second or two, most of them."""
LEVELS = tuple(case.name for case in own_kit().select(levels=["continuous", "strategies"]))
LEVEL_CASES = ("normal", "normal-ends", "normal-tails", "info-what", "info-impossible-pool", "info-pool-of-one")
"""The same for the levels that are asked for by name, all and few."""
LEVEL_NAMES = [mistake["name"] for mistake in LEVEL_MISTAKES]
LIMITS = {"linear-underflow": ("long-and-back",), "linear-likelihood": ("episode-paper-size",)}


def verdicts(words, names=()):
    cases = own_kit().select(names, () if names else BASIC)
    return with_causes(list(check_program(words, cases, Asked())), own_kit().cases, "double")


def test_the_c_program_passes_every_case(solid_c):
    assert {verdict.status for verdict in verdicts([str(word) for word in solid_c])} == {"pass"}


def test_the_script_passes_short_cases():
    assert {verdict.status for verdict in verdicts([*node(), str(FOLDER / "solid.js")], SHORT)} == {"pass"}


@pytest.mark.slow
def test_the_script_passes_every_case():
    assert {verdict.status for verdict in verdicts([*node(), str(FOLDER / "solid.js")])} == {"pass"}


@pytest.mark.slow
def test_the_c_program_passes_in_single_precision(tmp_path):
    """What 32 bits cannot do is left out, and that is not most of it."""
    words = compile_c(FOLDER / "solid.c", tmp_path / "single", "-O2", "-std=c99", "-DSOLIDTOUCH_REAL=float")
    found = Counter(
        v.status for v in check_program([str(words[0])], own_kit().select(levels=BASIC), Asked(precision="single"))
    )

    assert set(found) == {"pass", "left out"}
    assert found["pass"] > 75


def check_named(mistake, language, names, tmp_path):
    """The mistake is the likeliest cause of the cases that fail, apart from those that it makes fail otherwise."""
    source = mutant(mistake, language)
    file = tmp_path / f"wrong.{language}"
    file.write_text(source, encoding="utf-8")
    if language == "c":
        words = [str(word) for word in compile_c(file, tmp_path / "wrong", "-std=c99")]
    else:
        words = [*(node() if language == "js" else [sys.executable, "-I"]), str(file)]
    causes = Counter(v.cause for v in verdicts(words, names) if v.status != "pass")

    assert set(causes) <= {mistake["name"], ""}
    assert causes[mistake["name"]] > 3 * causes[""]


@pytest.mark.parametrize("mistake", slow_but([MISTAKES[i] for i in (0, 1, 2, 5, 8)], MISTAKES), ids=NAMES)
def test_each_mistake_in_c_is_found_and_named(mistake, tmp_path):
    check_named(mistake, "c", LIMITS.get(mistake["name"], SHORT), tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("language", ["c", "js"])
@pytest.mark.parametrize("mistake", MISTAKES, ids=NAMES)
def test_each_mistake_is_named_in_all_cases(mistake, language, tmp_path):
    check_named(mistake, language, (), tmp_path)


@pytest.mark.parametrize("names", [LEVEL_CASES, pytest.param(LEVELS, marks=pytest.mark.slow)], ids=["short", "all"])
@pytest.mark.parametrize("mistake", slow_but(LEVEL_MISTAKES[::3], LEVEL_MISTAKES), ids=LEVEL_NAMES)
def test_each_mistake_in_the_levels_asked_by_name_is_named(mistake, names, tmp_path):
    check_named(mistake, "py", names, tmp_path)
