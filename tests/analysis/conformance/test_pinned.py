"""An exported kit in place of the cases of this version."""

import json
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from solidtouch.analysis.conformance.catalogue import catalogue, expected, own_kit
from solidtouch.analysis.conformance.dataset.checksums import write_sums
from solidtouch.analysis.conformance.dataset.pinned import read_kit
from solidtouch.analysis.conformance.dataset.version import KIT_VERSION
from solidtouch.analysis.conformance.tolerance import allowed_decisions, allowed_moves, tolerances

import solidtouch as st

NAMES = [
    "root-j",
    "fit",
    "tables",
    "near-ties",
    "ties",
    "impossible-later",
    "bins-of-each-taxel",
    "shift-uniform-holes",
]
LEFT_OUT = {"case": "x", "level": "core", "about": "It is small.", "equations": [1], "reason": "it is too small"}
OTHER = "0.9.1"
"""A version whose cases this one does not know."""


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    folder = tmp_path_factory.mktemp("small") / "kit"
    st.conformance.export(folder, NAMES)
    return folder


@pytest.fixture
def copy(small, tmp_path):
    return shutil.copytree(small, tmp_path / "copy")


def edit(folder, name, change, version=None):
    """Changes a JSON file of a kit, and its checksum; also its version, if one is named."""
    for file, apply in ((name, change), ("index.json", lambda index: index.update(kit=version or index["kit"]))):
        whole = json.loads((folder / file).read_text())
        apply(whole)
        (folder / file).write_text(json.dumps(whole))
    (folder / "SHA256SUMS").unlink()
    write_sums(folder)


def right(case):
    return st.conformance.expected(case.name)


def test_cases_come_back_as_they_were(exported):
    """With their answers, tolerances and allowed choices, every number the same double."""
    read = read_kit(exported)

    assert (read.version, [*read.cases]) == (KIT_VERSION, [*catalogue()])
    for name, case in catalogue().items():
        given = read.cases[name]
        answers = expected(case)
        bounds = tolerances(case, answers, "double")
        assert [*given.lines()] == [*case.lines()]
        assert (given.level, given.about, given.equations, given.answered) == (
            case.level,
            case.about,
            case.equations,
            case.answered,
        )
        assert tolerances(given, expected(given), "double") == bounds
        for one, other in zip(expected(given), answers, strict=True):
            assert one.line(name) == other.line(name)
            if "decisions" in other.values:
                assert allowed_decisions(given, one, bounds["what"]) == allowed_decisions(case, other, bounds["what"])
                assert allowed_moves(given, one, bounds["where"]) == allowed_moves(case, other, bounds["where"])


def test_engines_and_programs_pass_a_pinned_kit(small, program):
    assert st.conformance.run_engine("numpy", kit=small).passed
    report = st.conformance.run_program([str(word) for word in program], kit=small)

    assert report.passed
    assert [*report.found] == NAMES


def test_the_answers_of_the_folder_count(copy):
    """Those of this version do not, nor do its tolerances and choices."""

    def change(whole):
        whole["expected"][0]["what"][0] += 0.25
        whole["tolerances"]["where"]["absolute"] = 9.0
        whole["expected"][1]["allowed_moves"] = [whole["expected"][1]["move"], 77]

    edit(copy, "root-j.json", change, OTHER)

    def wide(case):
        answers = right(case)
        answers[1] |= {"where": answers[1]["where"] + 5, "move": 77}
        return answers

    found = st.conformance.run(right, ["root-j", "ties"], kit=copy).found
    assert (found["root-j"].status, found["root-j"].tap, found["root-j"].quantity) == ("differs", 1, "what")
    assert found["ties"].status == "pass"
    assert st.conformance.expected("root-j", copy)[0]["what"][0] == right(catalogue()["root-j"])[0]["what"][0] + 0.25
    edit(
        copy,
        "root-j.json",
        lambda whole: whole["expected"][0].update(what=right(catalogue()["root-j"])[0]["what"].tolist()),
        OTHER,
    )
    assert st.conformance.run(wide, ["root-j"], kit=copy).passed
    assert not st.conformance.run(wide, ["root-j"]).passed


def test_causes_are_found_in_a_pinned_kit(small):
    def wrong(case):
        for answer in right(case):
            yield answer | {"move": -answer["move"]} if "move" in answer else answer

    report = st.conformance.run(wrong, ["root-j"], kit=small)
    assert report.found["root-j"].cause == "move-sign"


@pytest.mark.parametrize(
    ("name", "tap", "quantity"),
    [("root-j", 1, "what"), ("shift-uniform-holes", 3, "where"), ("root-j", 2, "posterior")],
)
def test_no_cause_is_named_where_the_answer_of_the_folder_is_another_than_that_of_this_version(
    copy, name, tap, quantity
):
    """A mistake that has no effect on the case is none of a right program."""

    def change(whole):
        answer = whole["expected"][tap - 1]
        answer[quantity] = (np.array(answer[quantity]) / 2).tolist()

    edit(copy, f"{name}.json", change, OTHER)

    verdict = st.conformance.run(right, [name], kit=copy).found[name]
    assert (verdict.status, verdict.tap, verdict.quantity, verdict.cause) == ("differs", tap, quantity, "")


def test_a_level_is_claimed_of_the_whole_kit_only(small, copy):
    """A folder with some of its cases says how many there are."""
    core, borders = (own_kit().sizes[level] for level in ("core", "borders"))

    assert st.conformance.run(right, kit=small).sentences[-1] == (
        f"Conformance kit {KIT_VERSION}: core: {core - 7} of {core} not asked; "
        f"borders: {borders - 1} of {borders} not asked."
    )
    edit(copy, "index.json", lambda whole: whole.update(kit=OTHER, levels={"core": 7, "borders": 1}))
    assert st.conformance.run(right, kit=copy).sentences[-1] == "Conformance kit 0.9.1: passes core, borders."


def test_cases_of_a_folder_are_chosen_and_listed(small):
    assert [case.name for case in st.conformance.cases(levels=["borders"], kit=small)] == ["shift-uniform-holes"]
    (case,) = st.conformance.cases("fit", kit=small)
    np.testing.assert_array_equal(case.training.taps, catalogue()["fit"].training.taps)
    with pytest.raises(st.InputError, match="case one-bin: there is no such case"):
        st.conformance.cases("one-bin", kit=small)


def test_a_folder_without_a_case_of_the_levels_asked_for_names_its_own(small):
    """Also where no level was named and the folder has only others than a check asks for."""
    with pytest.raises(st.InputError, match="no case of level limits; its levels are core, borders"):
        st.conformance.run(right, levels=["limits"], kit=small)


def test_a_folder_is_for_one_precision(small, tmp_path):
    st.conformance.export(tmp_path / "single", ["root-j"], precision="single")

    assert st.conformance.run(right, kit=tmp_path / "single", precision="single").passed
    with pytest.raises(st.InputError, match="its tolerances are for precision double, not single"):
        st.conformance.run(right, kit=small, precision="single")


def test_a_kit_for_single_precision_allows_the_same_claim_as_the_own_one(tmp_path):
    """Cases that 32 bits cannot do are left out, not forgotten."""
    st.conformance.export(tmp_path / "single", precision="single")
    own, pinned = (st.conformance.run(right, precision="single", kit=kit) for kit in (None, tmp_path / "single"))

    assert pinned.sentences == own.sentences
    assert "core (3 left out)" in pinned.sentences[-1]
    assert {**pinned.found} == {**own.found}
    assert pinned.levels == own.levels
    with pytest.raises(st.InputError, match=r"case single-edges: kit .* leaves it out, as 32 bits cannot do it"):
        st.conformance.expected("single-edges", tmp_path / "single")
    assert "single-edges" not in {case.name for case in st.conformance.cases(kit=tmp_path / "single")}


def of_new_level(version):
    def change(whole):
        whole["cases"][0]["level"] = "smell"
        whole["levels"]["smell"] = 3

    return lambda folder: edit(folder, "index.json", change, version)


def test_cases_of_a_level_of_a_newer_version_are_left_out_and_counted(copy):
    """Its other cases are asked."""
    of_new_level("1.99.0")(copy)
    report = st.conformance.run(right, kit=copy)

    assert [*report.found] == NAMES[1:]
    assert report.passed
    assert "Left out: 1 case of level 'smell', which this version of solidtouch does not know." in report.sentences
    assert report.sentences[-1].startswith("Conformance kit 1.99.0: core: ")


def test_a_kit_of_an_older_version_is_read():
    """As version 0.1.0 of the package wrote it; its cases are those of this version."""
    folder = Path(__file__).parent / "older" / "kit-1.0.0"
    report = st.conformance.run_engine("numpy", kit=folder)

    assert report.passed
    assert report.sentences[-1] == "Conformance kit 1.0.0: core: 55 of 60 not asked."
    for name in report.found:
        assert [*st.conformance.cases(name, kit=folder)[0].lines()] == [*catalogue()[name].lines()]
        old, new = (st.conformance.expected(name, kit) for kit in (folder, None))
        for one, other in zip(old, new, strict=True):
            np.testing.assert_equal(one, other)


def test_git_keeps_a_kit_as_it_is(small, tmp_path):
    """Also where it is told to change line ends."""
    if (git := shutil.which("git")) is None:
        pytest.skip("there is no git")
    shutil.copytree(small, tmp_path / "one" / "kit")

    environment = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}
    settings = ("user.name=x", "user.email=x@example.org", "core.autocrlf=true", "commit.gpgsign=false")
    given = [word for setting in settings for word in ("-c", setting)]

    def run(*words):
        subprocess.run([git, *given, *words], check=True, capture_output=True, env=environment)

    run("init", tmp_path / "one")
    run("-C", tmp_path / "one", "add", "--all")
    run("-C", tmp_path / "one", "commit", "--message", "kit")
    run("clone", tmp_path / "one", tmp_path / "two")

    assert read_kit(tmp_path / "two" / "kit").version == KIT_VERSION


def damage(name):
    return lambda folder: (folder / name).write_bytes((folder / name).read_bytes()[:-2])


def windows(name):
    return lambda folder: (folder / name).write_bytes((folder / name).read_bytes().replace(b"\n", b"\r\n"))


def lose(name):
    return lambda folder: (folder / name).unlink()


def edited(name, **values):
    return lambda folder: edit(folder, name, lambda whole: whole.update(values))


def of_first_answer(**values):
    return lambda folder: edit(folder, "root-j.json", lambda whole: whole["expected"][0].update(values))


def in_place_of_a_file(folder):
    """A pipe that nobody writes to."""
    (folder / "fit.jsonl").unlink()
    os.mkfifo(folder / "fit.jsonl")


@pytest.mark.parametrize(
    ("harm", "sentence"),
    [
        (shutil.rmtree, "copy: not a folder."),
        (lose("SHA256SUMS"), "copy: incomplete: SHA256SUMS is missing."),
        (lose("root-j.json"), "copy: incomplete: root-j.json is missing, which SHA256SUMS lists."),
        (damage("fit.jsonl"), "copy: damaged: fit.jsonl differs from its checksum in SHA256SUMS."),
        (
            windows("CHANGELOG.md"),
            "copy: damaged: CHANGELOG.md differs from its checksum in SHA256SUMS: its line ends are those of Windows, "
            "as git writes them with core.autocrlf.",
        ),
        (lambda folder: (folder / "SHA256SUMS").write_text("x\n"), "damaged: line 1 of SHA256SUMS is not a checksum"),
        (lambda folder: (folder / "SHA256SUMS").write_bytes(b"\xff"), "damaged: SHA256SUMS cannot be read"),
        (
            lambda folder: (folder / "SHA256SUMS").write_text(f"{'0' * 64}  ../x\n"),
            "damaged: line 1 of SHA256SUMS is not a checksum",
        ),
        (edited("index.json", format=2), "index.json has format 2, this version of solidtouch reads 1; a newer one"),
        (edited("fit.json", format=2), "fit.json has format 2, this version of solidtouch reads 1; a newer one"),
        (edited("index.json", cases=3), "index.json is not of format 1: Expected `array`, got `int` - at `$.cases`."),
        (of_new_level(KIT_VERSION), f"copy: index.json has another number of cases of 'smell' than kit {KIT_VERSION}."),
        (
            lambda folder: edit(folder, "index.json", lambda whole: whole["cases"][0].update(case="../root-j")),
            "incomplete: ../root-j.json is not in its checksums.",
        ),
        (
            edited("root-j.json", prior=[[1.0]]),
            "not of format 1: prior has shape [1, 1] instead of [5, 3].",
        ),
        (edited("root-j.json", prior=[[1.0], [0.5, 0.5]]), "root-j.json is not of format 1: "),
        (edited("root-j.json", border="open"), "root-j.json is not of format 1: Invalid enum value 'open'"),
        (edited("root-j.json", expected=[{"tap": 1, "posterior": [[1]]}]), "posterior of shape [1, 1], [5, 3] is due."),
        (
            edited("index.json", levels={"core": 7}),
            "index.json is not of format 1: levels has too few cases of 'borders'.",
        ),
        (
            edited("index.json", left_out=[LEFT_OUT]),
            "index.json is not of format 1: double precision leaves no case out.",
        ),
        (
            edited("index.json", precision="single", left_out=[LEFT_OUT | {"reason": ""}]),
            "index.json is not of format 1: left_out is not what it stands for.",
        ),
        (edited("root-j.json", tolerances={}), "root-j.json is not of format 1: no key '"),
        (edited("root-j.json", edges=[0.0, {}]), "root-j.json is not of format 1: float() argument must be"),
        (edited("root-j.json", edges=[9.0 - b for b in range(9)]), "not of format 1: edges is not what it stands for."),
        (edited("root-j.json", counts=None), "root-j.json is not of format 1: counts is not what it stands for."),
        (edited("root-j.json", power="K"), "root-j.json is not of format 1: power is not what it stands for."),
        (edited("root-j.json", fixation=5), "root-j.json is not of format 1: fixation is not what it stands for."),
        (edited("root-j.json", strategy="info-what"), "not of format 1: strategy is not what it stands for."),
        (
            lambda folder: edit(folder, "index.json", lambda whole: whole["cases"].append(whole["cases"][0])),
            "index.json is not of format 1: case root-j: it is listed twice.",
        ),
        (edited("root-j.json", level="borders"), "index.json is not of format 1: case root-j: its file has level"),
        *(
            (
                edited("index.json", kit=kit),
                f"index.json is not of format 1: kit is not a version such as {KIT_VERSION}.",
            )
            for kit in ("1\x1b[2J", "foo", "1.4", "v1.4.0", "1.04.0", "1.4.0\n", "1.4.0-rc1", "")
        ),
        (edited("root-j.json", about="\x1b[2J"), "root-j.json is not of format 1: about is not what it stands for."),
        (edited("root-j.json", expected=[]), "root-j.json is not of format 1: expected is not what it stands for."),
        (of_first_answer(tap=5), "root-j.json is not of format 1: expected is not what it stands for."),
        (of_first_answer(allowed_moves=["a"]), "root-j.json is not of format 1: Expected `int`, got `str`"),
        (
            lambda folder: edit(folder, "root-j.json", lambda whole: whole["expected"][0].pop("posterior")),
            "root-j.json is not of format 1: no key 'posterior'.",
        ),
        *(
            (edited("root-j.json", **values), f"copy: root-j.json is not the case of kit {KIT_VERSION}.")
            for values in (
                {"theta_x": 0.25},
                {"about": "It is another."},
                {"prior": (np.eye(5, 3) / 3).tolist(), "where_value": [1.0] * 5},
            )
        ),
        (of_first_answer(move=0), f"copy: root-j.json is not the case of kit {KIT_VERSION}."),
        (of_first_answer(allowed_moves=[0, 1, 2]), f"copy: root-j.json is not the case of kit {KIT_VERSION}."),
        (
            lambda folder: edit(folder, "root-j.json", lambda whole: whole["tolerances"]["what"].update(absolute=1.0)),
            f"copy: root-j.json is not the case of kit {KIT_VERSION}.",
        ),
        (
            edited("index.json", levels={**own_kit().sizes, "core": 7}),
            f"copy: index.json has another number of cases of 'core' than kit {KIT_VERSION}.",
        ),
        (
            edited("index.json", precision="single", cases=[], left_out=[LEFT_OUT | {"case": "root-j"}]),
            f"copy: index.json leaves root-j out, unlike kit {KIT_VERSION}.",
        ),
        (in_place_of_a_file, "copy: fit.jsonl cannot be read: not a file."),
        (edited("root-j.json", expected=[{}]), "root-j.json is not of format 1: no key 'tap'."),
    ],
)
def test_a_damaged_incomplete_or_newer_kit_is_refused_in_a_sentence(copy, harm, sentence):
    harm(copy)
    with pytest.raises(st.InputError) as error:
        st.conformance.run(right, kit=copy)

    assert str(error.value).startswith(f"kit {copy.parent}")
    assert sentence in str(error.value)
