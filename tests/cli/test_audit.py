"""`solidtouch audit`."""

import contextlib
import io
import json
import re
import sys
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from solidtouch.analysis.audit.report import AuditReport
from solidtouch.cli.main import run
from solidtouch.hardware.simulator.session import simulate_session
from solidtouch.hardware.simulator.settings import PAPER_RODS, preset
from solidtouch.models.io.model_file import load_model
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.setting_file import load_setting
from solidtouch.models.taps import TapSet

RIG = replace(preset("paper"), rods=PAPER_RODS[:3], start_mm=6.0, end_mm=10.0, spacing_mm=0.125)
QUICK = ("--permutations", "99", "--trials", "200", "--bins", "40")
KEYS = ("verdict", "first_cause", "miscalibration", "remedy")


class Audited(NamedTuple):
    """What a command wrote and printed."""

    code: int
    out: str
    err: str
    folder: Any

    @property
    def summary(self) -> dict[str, Any]:
        """`audit.json`, read by a reader that takes no NaN."""
        return json.loads((self.folder / "audit.json").read_text(), parse_constant=_refuse)


def _refuse(name: str) -> None:
    raise AssertionError(f"audit.json holds {name}")


def audited(folder, *words) -> Audited:
    """Runs the command outside of a test, for fixtures that several tests share."""
    out, err = io.StringIO(), io.StringIO()
    code = 0
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        patch.setattr(sys, "argv", ["solidtouch", "audit", *map(str, words), *QUICK, "--out", str(folder)])
        try:
            run()
        except SystemExit as stopped:
            code = int(stopped.code or 0)
    return Audited(code, out.getvalue(), err.getvalue(), folder)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Seven simulated sessions, 4 x 3 classes of 8 taps."""
    folder = tmp_path_factory.mktemp("sessions")
    paths = []
    for session in range(7):
        paths.append(folder / f"session-{session}.nc")
        simulate_session(RIG, 1, session).save(paths[-1])
    return paths


@pytest.fixture(scope="module")
def three(files, tmp_path_factory) -> Audited:
    """The audit of three files."""
    return audited(tmp_path_factory.mktemp("three") / "audit", *files[:3])


@pytest.mark.slow
def test_the_folder_holds_everything(three):
    """Numbers with a key for each question, one page with its figures, and the chosen setting with its model."""
    assert three.code == 0, three.err
    names = {path.name for path in three.folder.iterdir()}
    assert {"audit.json", "report.html", "setting.json", "model.nc"} <= names
    figures = {name.removesuffix(".svg") for name in names if name.endswith(".svg")}
    assert {"causes", "leakage", "taxels", "times", "remedies", "confusion", "guarantees"} <= figures
    summary = three.summary
    assert all("evidence" in summary[key] for key in KEYS)
    assert summary["files"] == {"Training taps": 96, "tuning taps": 96, "measuring taps": 96}
    assert summary["simulated"] is True
    assert summary["grid"] == {"L": 4, "M": 3}
    for one in (summary["verdict"]["evidence"]["judged"], summary["miscalibration"]["evidence"]["judged"]):
        for beside in (one["beside"], *(each["beside"] for each in one["each"].values())):
            assert set(beside) == {"value", "median", "low", "high", "above", "below"}
    rods = list(summary["miscalibration"]["evidence"]["at_stopping"]["each"])
    assert list(one["each"]) == rods
    assert list(summary["miscalibration"]["evidence"]["exceeded"]) == ["all", *rods]
    page = (three.folder / "report.html").read_text()
    tuned = {row["name"]: row["right_model"] for row in summary["remedy"]["evidence"]["ranking"] if row["right_model"]}
    assert set(tuned) == {"exponent", "falling exponent"}
    for row in tuned.values():
        assert row["taps"] == 8
        assert row["sentence"] in page
    assert f"a correct model on {one['taps']} taps per class gives" in page
    assert page.count("<td>no") + page.count("<td><strong>yes</strong>") >= 4
    for sentence in summary["verdict"]["sentences"]:
        assert re.sub(r"\W+", " ", sentence.split("(")[0]).strip() in re.sub(r"\W+", " ", page)
    assert "nan" not in re.sub(r"<[^>]*>", " ", re.sub(r"(?s)<(svg|style|script).*?</\1>", "", page)).lower().split()


@pytest.mark.slow
def test_the_terminal_says_what_the_page_says(three):
    """The short verdict word by word, every remedy, and where the page is."""
    printed = " ".join(three.out.split())
    for sentence in three.summary["verdict"]["short"]:
        assert " ".join(sentence.replace("**", "").split()) in printed
    for row in three.summary["remedy"]["evidence"]["ranking"]:
        assert all(word in printed for word in row["name"].split())  # long names wrap in their column
    assert str(three.folder / "report.html") in three.out.replace("\n", "")


@pytest.mark.slow
def test_tables_hold_the_numbers_of_the_file(three):
    evidence, report = three.summary["remedy"]["evidence"], AuditReport(None, three.summary)
    for row in evidence["ranking"]:
        at = report.remedies.sel(remedy=row["name"])
        assert [float(at[f"gain{end}"]) for end in ("", "_low", "_high")] == row["gain"]
        assert bool(at["worthwhile"]) == row["worthwhile"]
    for row in three.summary["first_cause"]["evidence"]["predictive_checks"]:
        assert float(report.checks["p"].sel(statistic=row["statistic"])) == row["p"]
    assert report.calibration["factor"].sizes == {"what": 4}
    assert float(report.leakage["chance"].sel(quantity="what")) == pytest.approx(1 / 3)
    assert report.after_taps.sizes["what"] == 4


@pytest.mark.slow
def test_numbers_belong_together(three):
    """Shares add up to one, the verdict names the first cause and the remedy of their own keys, remedies are ranked."""
    summary = three.summary
    parts = summary["first_cause"]["evidence"]["variance"]["parts"]
    assert sum(part["share"] or 0.0 for part in parts) == pytest.approx(1)
    assert summary["verdict"]["evidence"]["first_cause"] == summary["first_cause"]["name"]
    assert summary["verdict"]["evidence"]["remedy"] == summary["remedy"]["chosen"]
    assert summary["verdict"]["state"] == summary["miscalibration"]["state"]
    assert summary["verdict"]["sentences"][1] == summary["first_cause"]["sentence"]
    evidence = summary["miscalibration"]["evidence"]["at_stopping"]["all trials"]
    usual = summary["remedy"]["evidence"]["threshold"]
    assert (usual["before"], usual["taps_before"]) == pytest.approx((evidence["wrong"][0], evidence["taps"][0]))
    ranked = [row["gain"][0] for row in summary["remedy"]["evidence"]["ranking"]]
    assert ranked == sorted(ranked, reverse=True)
    assert len(ranked) == 6


@pytest.mark.slow
def test_a_preview_says_what_it_leaves_out(three, files, tmp_path):
    """Variance components are not sampled, neither told nor drawn; nothing is drawn for narrow windows."""
    done = audited(tmp_path / "audit", *files[:3], "--quick")
    assert done.code == 0, done.err
    components = done.summary["first_cause"]["evidence"]["components"]
    assert components["standard_deviations"] == components["effective_taps"] == []
    page = (done.folder / "report.html").read_text()
    assert components["sentences"][0].replace("`", "") in re.sub(r"<[^>]+>", "", page)
    assert (page.count("<picture>"), (three.folder / "report.html").read_text().count("<picture>")) == (0, 2)


@pytest.mark.slow
def test_what_is_chosen_is_taken_by_other_commands(command, three, files, tmp_path):
    """The setting fits the model; `perceive` and `reproduce` run with them."""
    setting, model = three.folder / "setting.json", three.folder / "model.nc"
    load_setting(setting).check_model(load_model(model), model, setting)
    done = command(
        "perceive",
        model,
        "--setting",
        setting,
        "--rig",
        f"replay:{files[2]}",
        "--engine",
        "filter",
        "--json",
        "--seed",
        1,
    )
    assert done.code == 0, done.err
    assert "decision" in json.loads(done.out.splitlines()[-1])
    done = command(
        "reproduce",
        "--data",
        files[0],
        files[2],
        "--quick",
        "--trials",
        20,
        "--setting",
        setting,
        "--out",
        tmp_path / "run",
    )
    assert done.code == 0, done.err
    assert f"Setting: {load_setting(setting).note}"[:40] in done.out


@pytest.mark.slow
def test_results_repeat_with_the_seed(three, files, tmp_path):
    """The same files and seed give the same numbers, another seed gives others."""
    again = audited(tmp_path / "again", *files[:3])
    other = audited(tmp_path / "other", *files[:3], "--seed", 1)

    def numbers(done):
        return {name: value for name, value in done.summary.items() if name not in ("elapsed_s", "command")}

    assert numbers(again) == numbers(three)
    assert (again.folder / "setting.json").read_text() == (three.folder / "setting.json").read_text()
    assert numbers(other)["remedy"] != numbers(three)["remedy"]


@pytest.mark.slow
def test_passive_audits_tune_passive_thresholds(files, tmp_path):
    """Neither the judged trials nor those that tune a threshold move."""
    done = audited(tmp_path / "audit", *files, "--target-error", "0.3", "--passive")
    assert done.code == 0, done.err
    evidence = done.summary["remedy"]["evidence"]
    assert evidence["policy"] == "passive"
    assert evidence["target_error"]["policy"] == "passive"
    assert load_setting(done.folder / "setting.json").play.passive


@pytest.mark.slow
def test_a_threshold_for_a_wanted_error_comes_with_its_prediction(files, tmp_path):
    """Five sessions tune it; the setting has it where it can be reached."""
    done = audited(tmp_path / "audit", *files, "--target-error", "0.3")
    assert done.code == 0, done.err
    target = done.summary["remedy"]["evidence"]["target_error"]
    assert target["sentence"] in " ".join(done.out.split())
    threshold = load_setting(done.folder / "setting.json").play.threshold
    assert threshold == (target["chosen"]["theta"] if target["reachable"] else 0.95)


def gaussian(session=0, *, objects=3, positions=2, repeats=6, J=4, K=3, **more) -> TapSet:
    """Taps of white noise about the mean of their class."""
    rng = np.random.default_rng(session)
    what, where, _ = (index.ravel() for index in np.indices((objects, positions, repeats)))
    samples = rng.normal(size=(len(what), J, K)) + (where + 2.0 * what)[:, None, None]
    arguments = {"where": where, "where_unit": "mm", "session": np.full(len(what), session), **more}
    names = [f"object {m}" for m in range(objects)]
    return TapSet.from_arrays(samples, what, names, preprocessing=Preprocessing(samples=J), **arguments)


ODD = {
    "two files": [gaussian(0), gaussian(1)],
    "single taps": [gaussian(s, repeats=1) for s in range(3)],
    "one taxel, one sample": [gaussian(s, J=1, K=1) for s in range(3)],
    "one object": [gaussian(s, objects=1, positions=3) for s in range(3)],
    "no positions": [gaussian(s, positions=1, where=None) for s in range(3)],
    "one file, one session": [gaussian(0, repeats=8)],
    "constant taps": [
        TapSet(taps.dataset.assign(taps=0 * taps.dataset["taps"] + 1)) for taps in (gaussian(s) for s in range(3))
    ],
}


@pytest.mark.slow
@pytest.mark.parametrize("name", ODD)
def test_little_data_give_a_page_all_the_same(name, tmp_path):
    """With numbers that JSON takes, and a setting that fits its model."""
    paths = []
    for number, taps in enumerate(ODD[name]):
        paths.append(tmp_path / f"{number}.nc")
        taps.save(paths[-1])
    done = audited(tmp_path / "audit", *paths)
    assert done.code == 0, done.err
    assert "Warning" not in done.err
    judged = done.summary["first_cause"]["evidence"]["leakage"]["judged"]
    assert len(done.summary["verdict"]["sentences"]) == (3 if judged else 4)
    setting, model = done.folder / "setting.json", done.folder / "model.nc"
    load_setting(setting).check_model(load_model(model), model, setting)
    if len(paths) < 3:
        assert "same session" in " ".join(done.summary["warnings"])
        first = done.summary["verdict"]["sentences"][0]
        alone = len(paths) == 1
        assert ("in other taps of the training session" in first) is alone
        assert ("There is one session, so calibration on another day is unknown" in first) is alone


BAD = {
    "no file": (0, (), "missing argument"),
    "missing": (3, ("none.nc",), "none.nc: no such file"),
    "threshold": (3, ("--theta", "1"), "--theta must lie between 0 and 1, got 1.0"),
    "NaN": (3, ("--theta", "nan"), "--theta must be a number from 0 to 1, got nan"),
    "move threshold": (3, ("--theta-x", "2"), "--theta-x must be a number from 0 to 1"),
    "wanted error": (3, ("--target-error", "0"), "--target-error must lie between 0 and 1"),
    "few sessions": (3, ("--target-error", "0.05"), "--target-error needs"),
    "fixation": (3, ("--fixation", "99"), "fixation"),
    "power": (3, ("--power", "K"), "power"),
    "permutations": (
        3,
        ("--permutations", "98"),
        "--permutations must be at least 99, got 98; see `solidtouch audit --help`.",
    ),
    "bins": (3, ("--bins", "0"), "bins"),
    "pseudocount": (3, ("--pseudocount", "-1"), "pseudocount"),
    "border": (3, ("--border", "wall"), "border"),
    "deadline": (3, ("--deadline", "0"), "deadline"),
    "range": (3, ("--value-range", "all"), "range"),
    "where cell": (3, ("--where-cell", "3s"), "--where-cell"),
    "one class": (3, ("--where-cell", "16mm", "--what-cell", "20mm"), "there is nothing to decide"),
}


@pytest.mark.parametrize(("number", "options", "message"), BAD.values(), ids=BAD)
def test_bad_input_is_said_in_a_sentence(number, options, message, command, files, tmp_path):
    """Before any work, with exit code 2 and nothing written."""
    done = command("audit", *files[:number], "--out", tmp_path / "audit", *options)
    assert done.code == 2
    assert message in " ".join(done.err.split())
    assert "Traceback" not in done.err
    assert not (tmp_path / "audit").exists()


def test_other_objects_are_refused(command, files, tmp_path):
    gaussian().save(tmp_path / "other.nc")
    done = command("audit", files[0], tmp_path / "other.nc", "--out", tmp_path / "audit")
    assert done.code == 2
    assert "session-0.nc has 12 taxels and other.nc has 3" in " ".join(done.err.split())


def test_a_folder_is_not_replaced_without_force(command, files, tmp_path):
    """This is said before any work."""
    (tmp_path / "audit").mkdir()
    (tmp_path / "audit" / "mine.txt").write_text("mine")
    done = command("audit", *files[:3], "--out", tmp_path / "audit")
    assert done.code == 2
    assert [path.name for path in (tmp_path / "audit").iterdir()] == ["mine.txt"]


@pytest.mark.slow
def test_an_interrupted_audit_leaves_nothing(command, files, tmp_path, monkeypatch):
    """Not even when it is stopped while it writes."""

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("solidtouch.analysis.page.report.write_page", stop)
    done = command("audit", *files[:3], *QUICK, "--out", tmp_path / "audit")
    assert done.code == 130
    assert list(tmp_path.iterdir()) == []
