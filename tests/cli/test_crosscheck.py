"""`crosscheck`: of one model, of all, and of those that cannot be checked."""

import pytest
from solidtouch.analysis.experiment.crosscheck import CrossCheck, RouteDifference


def agreeing(passed=True):
    row = RouteDifference("posterior", "numpy, filter", 0.0 if passed else 1.0, 1e-10)
    return CrossCheck((row,), 2, 5, 3, 0, 0, 0, ())


@pytest.fixture
def compared(monkeypatch):
    """The models that were compared, without the work of it; models in `differ` disagree."""
    seen = []
    differ = set()

    def compare(model, taps, **more):
        seen.append(model.name)
        return agreeing(model.name not in differ)

    monkeypatch.setattr("solidtouch.analysis.correctness.report.crosscheck_model", compare)
    return seen, differ


def test_crosscheck_takes_any_model(command, taps_file, compared):
    done = command("crosscheck", taps_file, "--model", "session:profile", "--bins", 9)

    assert done.code == 0
    assert compared[0] == ["session:profile"]
    assert "Model session:profile\n" in done.out


@pytest.mark.slow
def test_crosscheck_of_all_models_names_the_refused_ones(command, tmp_path, make_taps, compared):
    """One table each, and a reason for each that one sample per tap cannot carry."""
    make_taps(J=1).save(tmp_path / "taps.nc")
    done = command("crosscheck", tmp_path / "taps.nc", "--model", "all", "--bins", 9, "--allow-unconverged")

    assert done.code == 0
    assert compared[0] == ["histogram", "gaussian", "student", "profile-mvn", "matrix-normal", "smooth", "session"]
    for name in compared[0]:
        assert f"Model {name}\n" in done.out
    said = " ".join(done.out.split())
    assert "Model profile was not checked: profile needs more than one sample per tap" in said
    assert "7 of 9 models checked: all routes agree." in said


def test_crosscheck_of_all_models_ends_with_those_that_differ(command, taps_file, compared, monkeypatch):
    """And exit code 1; models are compared further."""
    monkeypatch.setattr("solidtouch.cli.crosscheck.NAMES", ("histogram", "gaussian", "profile"))
    compared[1].add("gaussian")
    done = command("crosscheck", taps_file, "--model", "all", "--bins", 9)

    assert done.code == 1
    assert compared[0] == ["histogram", "gaussian", "profile"]
    assert "3 of 3 models checked: the routes of gaussian DISAGREE." in " ".join(done.out.split())


def test_crosscheck_of_no_model_is_an_error(command, tmp_path, make_taps, monkeypatch, compared):
    make_taps(J=1).save(tmp_path / "taps.nc")
    monkeypatch.setattr("solidtouch.cli.crosscheck.NAMES", ("profile", "profile-ar"))
    done = command("crosscheck", tmp_path / "taps.nc", "--model", "all")

    assert done.code == 2
    assert "No model could be checked" in done.err


def test_crosscheck_leaves_numpyro_out_where_the_border_is_no_kernel(command, taps_file):
    done = command("crosscheck", taps_file, "--episodes", 1, "--length", 4, "--border", "prior", "--bins", 6)

    assert done.code == 0
    assert "not a Markov kernel" in done.out
    assert "numpy, numpyro" not in done.out
