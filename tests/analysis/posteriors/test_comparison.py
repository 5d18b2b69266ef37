"""Draws are called right or wrong, or undecided where chains have not mixed; files of other programs are read."""

import gzip
import shutil
import subprocess
from hashlib import sha256
from importlib.resources import files
from pathlib import Path

import arviz as az
import numpy as np
import pytest
from solidtouch.analysis.conformance import dataset
from solidtouch.analysis.posteriors import catalogue
from solidtouch.analysis.posteriors.catalogue import export, posterior
from solidtouch.analysis.posteriors.comparison import compare_draws
from solidtouch.analysis.posteriors.files import read_draws
from solidtouch.models.errors import InputError
from solidtouch.models.measurement.fits.nuts import sample_story
from solidtouch.models.measurement.registry import NAMES

DATA = Path(catalogue.__file__).parent / "data"
STAN = Path(__file__).parents[3] / "docs" / "reference" / "posteriors"


def verdict(name, draws=None):
    return compare_draws(posterior(name), read_draws([DATA / f"{name}.csv.gz"]) if draws is None else draws)


@pytest.fixture
def right():
    """Draws of `gaussian`, exact ones."""
    return read_draws([DATA / "gaussian.csv.gz"])


# The folder --------------------------------------------------------------------------------------------------------


def test_every_model_has_a_reference_posterior():
    """Under its own name."""
    assert {path.name.removesuffix(".csv.gz") for path in DATA.glob("*.csv.gz")} == set(NAMES)


def test_an_exported_folder_has_the_checksums_that_it_says(tmp_path):
    """All files but that of the checksums."""
    number = export(tmp_path / "reference")
    lines = (tmp_path / "reference" / "SHA256SUMS").read_text().splitlines()

    assert len(lines) == number - 1 == 3 * len(NAMES) + 5
    assert (tmp_path / "reference" / "LICENSE").read_bytes() == files(dataset).joinpath("LICENSE").read_bytes()
    for line in lines:
        digest, name = line.split("  ")
        assert sha256((tmp_path / "reference" / name).read_bytes()).hexdigest() == digest, name
    with pytest.raises(InputError, match="exists"):
        export(tmp_path / "reference")


@pytest.mark.parametrize("name", NAMES)
def test_the_draws_in_the_folder_are_of_the_moments_in_it(name):
    """Of every model."""
    assert verdict(name).status == "pass", verdict(name).sentences


@pytest.mark.slow
@pytest.mark.parametrize("name", ["histogram", "gaussian", "profile", "profile-ar"])
def test_chains_of_a_story_have_its_exact_moments(name):
    """Those of NUTS in NumPyro."""
    from benchmarks.posteriors.make import numbers
    from benchmarks.posteriors.targets import targets

    (target,) = (target for target in targets() if target.name == name)
    sites = sample_story(target.story, lambda sites: sites, steps=3000).samples
    found = verdict(name, numbers({key: sites[key] for key in target.scales}, target.scales))
    assert found.status == "pass", found.sentences


@pytest.mark.slow
@pytest.mark.parametrize("name", ["gaussian", "student"])
def test_draws_of_stan_have_the_moments_of_the_reference(name, tmp_path):
    """The programs in docs/reference/posteriors, run by rstan."""
    rscript = shutil.which("Rscript")
    needed = "library(rstan); library(jsonlite)"
    if rscript is None or subprocess.run([rscript, "-e", needed], capture_output=True, check=False).returncode:
        pytest.skip("R with rstan and jsonlite is not installed")
    words = [STAN / "sample.R", STAN / f"{name}.stan", DATA / f"{name}.data.json", tmp_path / "draws.csv"]
    done = subprocess.run([rscript, *words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr

    found = verdict(name, read_draws([tmp_path / "draws.csv"]))
    assert found.status == "pass", found.sentences


# The verdict -------------------------------------------------------------------------------------------------------


def test_a_shifted_number_is_named(right):
    """With its moment, value and distance."""
    right["level.2.1.2"] += 0.05
    found = verdict("gaussian", right)

    assert (found.status, found.differences[0].name, found.differences[0].moment) == ("differs", "level.2.1.2", "mean")
    assert "the mean of level.2.1.2 is" in found.sentences[1]


def test_a_spread_that_is_too_wide_is_named(right):
    """Though the mean is right."""
    values = right["level.3.2.1"]
    right["level.3.2.1"] = values.mean() + 1.2 * (values - values.mean())
    found = verdict("gaussian", right)

    assert (found.status, found.differences[0].name, found.differences[0].moment) == (
        "differs", "level.3.2.1", "variance",
    )  # fmt: skip


def test_chains_apart_are_not_judged(right):
    """Their R-hat and its number are named."""
    right["level.1.1.1"][0] += 1.0
    found = verdict("gaussian", right)

    assert found.status == "undecided"
    assert "level.1.1.1 has not mixed" in found.sentences[0]


def test_few_draws_are_not_judged(right):
    """Of one chain, which has no R-hat; and it is not said that they have not mixed."""
    found = verdict("gaussian", {name: values[:1, :300] for name, values in right.items()})

    assert found.status == "undecided"
    assert "too few draws" in found.sentences[0]


def test_a_chain_that_is_given_twice_is_refused(right):
    """Its draws would count as independent."""
    with pytest.raises(InputError, match="Two chains have the same draws"):
        verdict("gaussian", {name: values[[0, 1, 0]] for name, values in right.items()})


@pytest.mark.filterwarnings("ignore:(overflow|invalid value)")
@pytest.mark.parametrize(("factor", "status"), [(1e300, "undecided"), (1e100, "differs"), (0.0, "differs")])
def test_draws_of_any_size_are_not_passed(right, factor, status):
    """Also those whose squares overflow, and equal ones."""
    right["level.1.1.1"] *= factor

    assert verdict("gaussian", right).status == status


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (lambda draws: draws.pop("variance.1.1.1"), "no number variance.1.1.1"),
        (lambda draws: draws["variance.1.1.1"].fill(-1.0), r"be positive, as .* draw 1 of chain 1 is -1\."),
        (lambda draws: draws["level.1.1.1"][1:, 2:].fill(np.nan), "be finite; draw 3 of chain 2 is nan"),
        (lambda draws: draws.update({"level.1.1.1": np.zeros((2, 3))}), "too few: 2 chains of 3 draws; at least one"),
    ],
)
def test_draws_that_cannot_be_judged_are_refused(right, change, match):
    """By the name of the number."""
    change(right)

    with pytest.raises(InputError, match=match):
        verdict("gaussian", right)


def test_an_unknown_posterior_is_refused():
    """The known ones are named."""
    with pytest.raises(InputError, match="no reference posterior 'gauss'; choose from histogram, gaussian"):
        posterior("gauss")


# Files -------------------------------------------------------------------------------------------------------------


def written(draws, form):
    """Text of CSV files in the form of other programs."""
    names = [form(*name.split(".")) for name in draws]
    for chain in range(len(next(iter(draws.values())))):
        rows = zip(*(values[chain] for values in draws.values()), strict=True)
        yield "\n".join([",".join(names), *(",".join(map(repr, map(float, row))) for row in rows)]) + "\n"


@pytest.mark.parametrize(
    "form",
    [
        lambda word, *index: ".".join((word, *index)),
        lambda word, *index: f'"{word}_[{",".join(index)}]"',
        lambda word, *index: f'"{word}[{", ".join(index)}]"',
    ],
    ids=["CmdStan", "rstan", "Turing"],
)
def test_files_of_each_chain_are_read(right, form, tmp_path):
    """With names as programs write them, and comments."""
    paths = [tmp_path / f"{chain}.csv" for chain in range(10)]
    for path, text in zip(paths, written(right, form), strict=True):
        path.write_text(f"# stan\n{text}# Elapsed\n\n")
    found = read_draws(paths)

    assert set(found) == set(right)
    np.testing.assert_array_equal(found["variance.3.2.1"], right["variance.3.2.1"])


def test_a_netcdf_file_is_read(right, tmp_path):
    """Of ArviZ, or the parameters alone; axes of length 1 are left out, as NumPyro's plates have them."""
    level = np.stack([right[name] for name in right if name.startswith("level")], axis=-1).reshape(10, 100, 3, 2, 1, 2)
    of_arviz = az.from_dict({"posterior": {"level_": level}})
    of_arviz.to_netcdf(tmp_path / "draws.nc")
    of_arviz["posterior"].to_dataset().to_netcdf(tmp_path / "flat.nc")

    for path in (tmp_path / "draws.nc", tmp_path / "flat.nc"):
        found = read_draws([path])
        assert set(found) == {name for name in right if name.startswith("level")}
        np.testing.assert_array_equal(found["level.2.1.2"], right["level.2.1.2"])
    with pytest.raises(InputError, match="must hold all chains"):
        read_draws([tmp_path / "draws.nc", tmp_path / "flat.nc"])


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("", "has no draws"),
        ("a,b\n", "has no draws"),
        ("a,b\n1\n", "draw 1 has 1 instead of 2 numbers"),
        ("a,b\n1,2\n1\n", "draw 2 has 1 instead of 2 numbers"),
        ("a,b\n1,2\n3,x\n", "draw 2, column 2: 'x' is not a number"),
        ("a[1,1],a[1,2]\n1,2\n", "names with commas between brackets need quotation marks"),
        ("a[1],a.1\n1,2\n", "has a.1 twice"),
    ],
)
def test_damaged_files_are_refused(text, match, tmp_path):
    """With the name of the file."""
    (tmp_path / "draws.csv").write_text(text)

    with pytest.raises(InputError, match=match) as caught:
        read_draws([tmp_path / "draws.csv"])
    assert "draws.csv" in str(caught.value)


def test_chains_of_one_file_may_alternate(right, tmp_path):
    """As tables sorted by the number of the draw."""
    head, *rows = gzip.decompress((DATA / "gaussian.csv.gz").read_bytes()).decode().splitlines()
    order = np.arange(len(rows)).reshape(10, 100).T.ravel()
    (tmp_path / "draws.csv").write_text("\n".join([head, *(rows[i] for i in order)]))

    np.testing.assert_equal(read_draws([tmp_path / "draws.csv"]), right)


def test_files_that_are_not_text_are_refused(tmp_path):
    """Missing ones and damaged compressed ones."""
    data = gzip.compress(b"a\n1\n" * 99)
    (tmp_path / "draws.csv.gz").write_bytes(data[:-9])
    (tmp_path / "other.csv.gz").write_bytes(data[:12] + b"\xff" + data[13:])

    for name in ("draws.csv.gz", "other.csv.gz", "none.csv"):
        with pytest.raises(InputError, match=f"{name}: (cannot read|not CSV)"):
            read_draws([tmp_path / name])


def test_chains_of_different_length_are_refused(tmp_path):
    """Both files are named."""
    (tmp_path / "1.csv").write_text("a\n1\n2\n")
    (tmp_path / "2.csv").write_text("a\n1\n")

    with pytest.raises(InputError, match=r"1\.csv.*2\.csv differ"):
        read_draws([tmp_path / "1.csv", tmp_path / "2.csv"])
