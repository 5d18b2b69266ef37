"""What is packed is what there is, and files that others read about the package agree with pyproject.toml."""

import importlib.util
import json
import re
import subprocess
import tomllib
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PROJECT, SETUPTOOLS = PYPROJECT["project"], PYPROJECT["tool"]["setuptools"]
WORKFLOWS = sorted((ROOT / ".github/workflows").glob("*.yml"))
CALLERS = [*WORKFLOWS, *(ROOT / name for name in (".pre-commit-config.yaml", ".devcontainer/devcontainer.json"))]
"""Files that call make."""
LEFT_OUT = {"__pycache__", ".pytest_cache"}


def text(name):
    """A file of the repository."""
    return (ROOT / name).read_text(encoding="utf-8")


def requirements(lines):
    """Names and bounds of requirements, as `("numpy", ">=2.3")`."""
    return dict(re.fullmatch(r"([\w.-]+)(?:\[[\w,-]+\])? *(.*)", line).groups() for line in lines)


def folders():
    """Folders of the packages with their package names."""
    for package, folder in SETUPTOOLS["package-dir"].items():
        for path in [ROOT / folder, *(ROOT / folder).rglob("*/")]:
            if path.name not in LEFT_OUT:
                yield ".".join((package, *path.relative_to(ROOT / folder).parts)), path


def test_every_folder_of_the_packages_is_packed():
    assert sorted(SETUPTOOLS["packages"]) == sorted(name for name, _ in folders())


def test_every_file_of_the_packages_is_packed():
    """Those that are no modules by their endings; each pattern has a file."""
    data = SETUPTOOLS["package-data"]
    found = {(name, file) for name, path in folders() for file in path.iterdir() if file.is_file()}
    packed = {(name, file) for name, file in found if any(file.match(pattern) for pattern in data.get(name, ()))}

    assert {file for name, file in found - packed if file.suffix != ".py"} == set()
    for name, patterns in data.items():
        assert all(any(of == name and file.match(pattern) for of, file in packed) for pattern in patterns), name


@pytest.fixture(scope="module")
def description():
    """The function of setup.py."""
    spec = importlib.util.spec_from_file_location("setup_of_solidtouch", ROOT / "setup.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.description


def links(page):
    """Targets of links and pictures outside of code."""
    return re.findall(r"\]\(([^)\s]+)\)", re.sub(r"^```.*?^```$", "", page, flags=re.MULTILINE | re.DOTALL))


def test_on_an_index_no_link_of_the_readme_is_dead(description):
    """And nothing else of it is lost."""
    readme = text("README.md")
    plain = description(readme)

    assert [target for target in links(plain) if not re.match(r"https?://|#", target)] == []
    assert "![" not in plain
    assert re.findall(r"^#.*", plain, flags=re.MULTILINE) == re.findall(r"^#.*", readme, flags=re.MULTILINE)
    assert re.findall(r"^```.*?^```$", plain, flags=re.M | re.S) == re.findall(
        r"^```.*?^```$", readme, flags=re.M | re.S
    )
    assert "protocol `TouchSensor` in hardware/sensor.py." in plain


def test_on_an_index_links_lead_to_a_repository_that_is_known(description):
    page = "![a](pages/a.svg) [b](pages/b.md#c) [d](https://e.org)\n\n```sh\n[f](g)\n```"

    assert description(page, "https://r.org/s", "v1") == (
        "![a](https://r.org/s/raw/v1/pages/a.svg) [b](https://r.org/s/blob/v1/pages/b.md#c) [d](https://e.org)"
        "\n\n```sh\n[f](g)\n```"
    )
    assert description(page) == " b [d](https://e.org)\n\n```sh\n[f](g)\n```"


@pytest.mark.parametrize(
    ("page", "plain", "pointed"),
    [
        ("[a [b]](c.md)", "a [b]", "[a [b]](r/blob/v1/c.md)"),
        ("[![a](b.svg)](c.md)", "", "[![a](r/raw/v1/b.svg)](r/blob/v1/c.md)"),
        ("`[a](b.md)` [`c`](d.md)", "`[a](b.md)` `c`", "`[a](b.md)` [`c`](r/blob/v1/d.md)"),
        ("[a](mailto:b@c.org)", "[a](mailto:b@c.org)", "[a](mailto:b@c.org)"),
    ],
)
def test_links_with_brackets_pictures_and_code_are_whole_on_an_index(description, page, plain, pointed):
    assert (description(page), description(page, "r", "v1")) == (plain, pointed)


def test_a_version_is_the_same_everywhere():
    """In the package, its citation, recipe and changelog, whose latest version it is."""
    version = PROJECT["version"]

    citation = yaml.safe_load(text("CITATION.cff"))
    assert citation["version"] == version
    assert yaml.safe_load(text("packaging/conda/recipe.yaml"))["context"]["version"] == version
    released = re.findall(r"^## \[(\d[\w.]*)\] - (\S+)$", text("CHANGELOG.md"), flags=re.MULTILINE)[0]
    assert released == (version, str(citation["date-released"]))


def test_the_conda_recipe_has_the_bounds_of_the_package():
    recipe = yaml.safe_load(text("packaging/conda/recipe.yaml"))
    needed = requirements(PROJECT["dependencies"])
    needed["matplotlib-base"] = needed.pop("matplotlib")  # without Qt
    (python, *run) = recipe["requirements"]["run"]
    built = requirements(recipe["requirements"]["host"])

    assert python == f"python {PROJECT['requires-python']}"
    assert requirements(run) == needed | {"h5netcdf": ""}  # of arviz[h5netcdf]
    assert built["setuptools"] == requirements(PYPROJECT["build-system"]["requires"])["setuptools"]
    assert recipe["build"]["python"]["entry_points"] == [f"{n} = {f}" for n, f in PROJECT["scripts"].items()]
    assert (recipe["about"]["summary"], recipe["about"]["license"]) == (PROJECT["description"], PROJECT["license"])


def versions_of(job):
    """Versions of Python that a job of a workflow runs."""
    matrix = job.get("strategy", {}).get("matrix", {})
    return matrix.get("python", [])


def test_the_workflow_tests_the_versions_of_python_that_the_package_names():
    jobs = yaml.safe_load(text(".github/workflows/checks.yml"))["jobs"]
    named = re.findall(r"Python :: (3\.\d+)", "\n".join(PROJECT["classifiers"]))

    assert PROJECT["requires-python"] == f">={named[0]}"
    assert versions_of(jobs["test"]) == versions_of(jobs["windows"]) == named
    assert [bound["python"] for bound in jobs["bounds"]["strategy"]["matrix"]["include"]] == [named[0], named[-1]]


def called(path):
    """Targets of make that a file calls."""
    if path.suffix == ".json":
        commands = [json.loads(path.read_text(encoding="utf-8"))["postCreateCommand"]]
    elif path in WORKFLOWS:
        jobs = yaml.safe_load(path.read_text(encoding="utf-8"))["jobs"].values()
        targets = [i["target"] for job in jobs for i in job.get("strategy", {}).get("matrix", {}).get("include", ())]
        commands = [step["run"] for job in jobs for step in job["steps"] if "run" in step]
        commands += [f"make {target}" for target in targets]
    else:
        commands = [
            hook["entry"]
            for repo in yaml.safe_load(path.read_text(encoding="utf-8"))["repos"]
            for hook in repo["hooks"]
        ]
    return re.findall(r"^make ([\w-]+)", "\n".join(commands), flags=re.MULTILINE)


@pytest.mark.parametrize("path", CALLERS, ids=lambda path: path.name)
def test_targets_that_others_call_exist(path):
    targets = set(re.search(r"^\.PHONY: (.*)", text("Makefile"), flags=re.MULTILINE)[1].split())

    assert called(path)
    assert set(called(path)) <= targets


def test_targets_are_explained():
    """By `make help`."""
    targets = re.search(r"^\.PHONY: (.*)", text("Makefile"), flags=re.MULTILINE)[1].split()
    told = subprocess.run(["make", "help"], cwd=ROOT, capture_output=True, text=True, check=True).stdout  # noqa: S607

    assert [
        name for name in targets if name != "help" and not re.search(rf"(^make |; |or ){name}\b", told, re.MULTILINE)
    ] == []


def test_the_firmware_is_not_tested_without_its_sources():
    """As all tests would be skipped. Nothing is run."""
    without, given = (
        subprocess.run(
            ["make", "--dry-run", "firmware", f"GRBL={folder}", "SOLIDTOUCH_GRBL="],  # noqa: S607
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=False,
        )
        for folder in ("", "grbl")
    )

    assert without.returncode == 2
    assert without.stderr.endswith("firmware needs a checkout of GRBL's sources: make firmware GRBL=DIR.  Stop.\n")
    assert (given.returncode, 'SOLIDTOUCH_GRBL="grbl"' in given.stdout) == (0, True)


def test_the_image_gets_what_the_wheel_is_made_of():
    kept = re.findall(r"^!(.*)", text(".dockerignore"), flags=re.MULTILINE)

    assert set(SETUPTOOLS["package-dir"].values()) | {"pyproject.toml", "setup.py", "README.md", "LICENSE"} <= set(kept)
    assert all((ROOT / name).exists() for name in kept)
    assert "constraints.txt" in kept
    assert re.search(r"^USER (?!root)", text("packaging/Dockerfile"), flags=re.MULTILINE)
