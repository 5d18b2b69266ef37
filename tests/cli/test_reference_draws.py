"""`solidtouch conformance posteriors` and `draws`."""

import gzip
from pathlib import Path

from solidtouch.analysis.posteriors import catalogue
from solidtouch.cli.main import app
from typer.testing import CliRunner

DRAWS = Path(catalogue.__file__).parent / "data" / "gaussian.csv.gz"


def command(*words):
    return CliRunner().invoke(app, ["conformance", *map(str, words)])


def test_posteriors_are_listed_and_written(tmp_path, monkeypatch):
    """Without a folder they are only listed; the name of a posterior is not taken for a folder."""
    monkeypatch.chdir(tmp_path)
    listed, written, named = (
        command("posteriors"),
        command("posteriors", "reference"),
        command("posteriors", "gaussian"),
    )

    assert "gaussian: 24 numbers, exact\n  variance[c,k] ~ InverseGamma(2, 2)" in listed.output
    assert "SHA256SUMS lists them" in written.output
    assert (tmp_path / "reference" / "student.data.json").is_file()
    assert "gaussian is the name of a reference posterior; give" in str(named.exception)


def test_the_exit_code_tells_of_the_verdict(tmp_path):
    """1 where draws differ, and what differs is named."""
    head, *rows = gzip.decompress(DRAWS.read_bytes()).decode().splitlines()
    wide = [row.split(",") for row in rows]
    moved = [",".join((chain, str(1.3 * float(first)), *rest)) for chain, first, *rest in wide]
    (tmp_path / "draws.csv").write_text("\n".join([head, *moved]))
    right, wrong = command("draws", "gaussian", DRAWS), command("draws", "gaussian", tmp_path / "draws.csv")

    assert (right.exit_code, wrong.exit_code) == (0, 1)
    assert "gaussian, reference 1.1.0: pass; 48 moments" in right.output
    assert "of level.1.1.1 is" in wrong.output
