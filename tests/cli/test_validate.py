"""`validate`: all is well where all is well, and what is not is named."""

import pickle
from dataclasses import replace

import pytest
from solidtouch.analysis.conformance import run
from solidtouch.analysis.conformance.catalogue import catalogue
from solidtouch.analysis.correctness import sbc, sbc_trials
from solidtouch.analysis.validation import checks
from solidtouch.cli.main import app
from typer.testing import CliRunner

NAMES = ("root-j", "shift-prior", "episode-clamp")


@pytest.fixture(scope="module")
def cases():
    every = catalogue()
    return {name: every[name] for name in NAMES}


@pytest.fixture
def short(monkeypatch, cases):
    """Three cases, few episodes and as few taps as they need."""
    monkeypatch.setattr(sbc_trials, "_PER_CLASS", 100)
    monkeypatch.setattr(sbc_trials, "_AT_FIXATION", 500)
    monkeypatch.setattr("solidtouch.analysis.conformance.catalogue.catalogue", lambda: cases)
    monkeypatch.setattr(checks, "SHORT", {"filter": 60, "cpu": 60})
    monkeypatch.setattr(checks, "ROUTES", ("numpy", "montecarlo"))
    monkeypatch.setattr(checks, "_routes", lambda _seed: ("nothing differs", True))


def test_every_check_passes_and_the_last_line_says_so(short):
    done = CliRunner().invoke(app, ["validate", "--workers", "1"])

    assert done.exit_code == 0, done.output
    assert done.output.splitlines()[-1] == "All 5 checks passed."
    assert done.output.count("3 of 3 cases pass") == 2


def test_an_engine_that_is_wrong_is_named_with_its_first_case(short, monkeypatch):
    """A belief off by 1e-6 in one case."""
    right = run.routes.answers

    def wrong(route, case):
        for answer in right(route, case):
            off = {"posterior": answer.values["posterior"] + 1e-6 * (case.name == "shift-prior" and route == "numpy")}
            yield replace(answer, values={**answer.values, **off})

    monkeypatch.setattr(run.routes, "answers", wrong)
    done = CliRunner().invoke(app, ["validate", "--workers", "1"])

    assert done.exit_code == 1
    assert done.output.splitlines()[-1] == "1 of 5 checks FAILED: engine numpy."
    assert "shift-prior: DIFFERS tap 1: posterior" in " ".join(done.output.split())


def test_a_check_has_the_seed():
    found = checks.checked(checks.Planned("check", "truth", lambda seed: (f"seed {seed}", seed > 6)), 7)

    assert (found.name, found.against, found.found, found.passed) == ("check", "truth", "seed 7", True)


@pytest.mark.slow
def test_beliefs_that_are_too_cautious_are_found(short, monkeypatch):
    calibrate = sbc.calibrate

    def rooted(truth, trials, **options):
        return calibrate(truth, trials, believed=replace(truth, power="J"), **options)

    monkeypatch.setattr(checks, "SHORT", {"filter": 120})
    monkeypatch.setattr(sbc, "calibrate", rooted)
    done = CliRunner().invoke(app, ["validate", "--workers", "1"])

    assert done.exit_code == 1
    assert done.output.splitlines()[-1] == "1 of 4 checks FAILED: beliefs, engine filter."


def test_checks_can_be_sent_to_other_processes():
    planned = checks.checks()

    sent = pickle.loads(pickle.dumps(planned))  # noqa: S301

    assert [check[:2] for check in sent] == [check[:2] for check in planned]
    assert len({check.name for check in sent}) == len(sent) == 1 + len(checks.ROUTES) + len(checks.SHORT)


@pytest.mark.slow
def test_the_whole_command_passes(capsys):
    done = CliRunner().invoke(app, ["validate", "--seed", "3"])

    assert done.exit_code == 0, done.output
    assert f"{len(catalogue())} of {len(catalogue())} cases pass" in " ".join(done.output.split())
