"""The GitHub action and the container of docs/reference/conformance."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
import yaml
from foreign_programs import FOLDER

ACTION = yaml.safe_load((FOLDER / "action.yml").read_text(encoding="utf-8"))
STEPS = {step.get("name", step.get("uses")): step for step in ACTION["runs"]["steps"]}
CONTAINER = (FOLDER / "Containerfile").read_text(encoding="utf-8")


def test_the_action_is_one():
    """Each input is described and used, and every value of an input comes by the environment."""
    text = json.dumps(ACTION["runs"])

    assert ACTION["runs"]["using"] == "composite"
    assert {"name", "description"} <= set(ACTION)
    assert set(re.findall(r"\$\{\{ inputs\.(\w+) \}\}", text)) == set(ACTION["inputs"])
    for given in ACTION["inputs"].values():
        assert given["description"]
        assert given.get("required", False) != ("default" in given)
    for step in STEPS.values():
        assert "shell" in step if "run" in step else re.fullmatch(r"[\w/-]+@v\d+", step["uses"])
        assert "${{" not in step.get("run", "")


@pytest.mark.parametrize(
    ("levels", "suites", "kit"),
    [
        ("episodes", ["episodes"], ""),
        pytest.param("", ["core", "episodes", "borders", "limits"], "exported", marks=pytest.mark.slow),
    ],
)
def test_the_step_of_the_action_checks_and_reports(tmp_path, solid_c, request, levels, suites, kit):
    """As bash runs it on a machine of GitHub; a program that answers nothing ends it with exit code 1.

    One that passes is seen by the slow test.
    """
    for command, code in ((str(solid_c[0]), 0), ("true", 1))[1 - bool(kit) :]:
        done = check(tmp_path, command=command, levels=levels, kit=kit and str(request.getfixturevalue(kit)))
        report = ET.parse(tmp_path / "report.xml").getroot()  # noqa: S314 - it was written here

        assert (done.returncode, "cases pass" in done.stdout) == (code, True), done.stderr
        assert [suite.get("name") for suite in report] == suites
        assert report.get("failures") == ("0" if code == 0 else report.get("tests"))


def test_the_action_gives_further_options_as_words(tmp_path):
    """Quotes count as in a shell, but nothing is run."""
    options = "--case root-j --no-causes\n--timeout 30  --together"
    done = check(tmp_path, command="true", options=options)
    report = ET.parse(tmp_path / "report.xml").getroot()  # noqa: S314 - it was written here
    evaluated = check(tmp_path, command="true", options=f"--case '$(touch {tmp_path}/a)`touch {tmp_path}/b`; c *'")
    unclosed = check(tmp_path, command="true", options="--case 'root-j")

    assert (done.returncode, report.get("tests"), report.get("time")) == (1, "1", None), done.stderr
    assert evaluated.returncode == 2
    assert f"case $(touch {tmp_path}/a)`touch {tmp_path}/b`; c *: there is no such case" in evaluated.stderr
    assert {path.name for path in tmp_path.iterdir()} == {"report.xml", "solidtouch"}
    assert (unclosed.returncode, unclosed.stderr) == (1, "options: No closing quotation.\n")


def test_the_program_of_the_action_runs_with_the_path_of_the_caller(tmp_path):
    """So that `python` is the one for which earlier steps have installed something."""
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "python").write_text('#!/bin/sh\necho "my own python" >&2\nexit 3\n')
    (tmp_path / "own" / "python").chmod(0o755)
    path = f"{tmp_path / 'own'}{os.pathsep}{os.environ['PATH']}"
    done = check(tmp_path, path, command="python program.py", options="--case root-j")

    assert "it said: my own python" in done.stdout, done.stderr


def test_the_action_installs_beside_the_python_of_the_caller(tmp_path):
    """In an environment of its own, which a second use replaces."""
    python = next(step for step in STEPS.values() if "setup-python" in step.get("uses", ""))
    old = tmp_path / "solidtouch" / "old"
    old.mkdir(parents=True)
    env = {"PYTHON": sys.executable, "SOLIDTOUCH": "pip", "RUNNER_TEMP": str(tmp_path)}
    done = bash(STEPS["Install"]["run"], env)

    assert python["with"]["update-environment"] is False
    assert STEPS["Install"]["env"]["PYTHON"] == f"${{{{ steps.{python['id']}.outputs.python-path }}}}"
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "solidtouch" / "bin" / "pip").exists()
    assert not old.exists()


def test_reports_of_several_uses_have_names_of_their_own():
    assert STEPS["Keep the report"]["with"]["name"] == "${{ inputs.artifact }}"


def check(tmp_path, path=os.environ["PATH"], **inputs):
    """The step that checks, with these inputs and this search path, in the environment of these tests."""
    inputs = {name: given.get("default", "") for name, given in ACTION["inputs"].items()} | inputs
    inputs |= {"report": str(tmp_path / "report.xml")}
    step = STEPS["Check"]
    given = {name: inputs[re.search(r"inputs\.(\w+)", value)[1]] for name, value in step["env"].items()}
    if not (tmp_path / "solidtouch").exists():
        (tmp_path / "solidtouch").symlink_to(Path(sys.executable).parent.parent)
    return bash(step["run"], given | {"RUNNER_TEMP": str(tmp_path), "PATH": path})


def bash(script, env):
    """A script as GitHub runs it."""
    if (program := shutil.which("bash")) is None:
        pytest.skip("there is no bash")
    return subprocess.run(
        [program, "-eo", "pipefail", "-c", script], env=os.environ | env, capture_output=True, text=True, check=False
    )


def test_the_container_runs_the_command_as_a_user():
    """And not as root; its words are those of an installed wheel."""
    words = dict(line.split(" ", 1) for line in CONTAINER.splitlines() if re.match("[A-Z]+ ", line))

    assert json.loads(words["ENTRYPOINT"]) == ["solidtouch", "conformance"]
    assert words["USER"] in re.search(r"useradd --create-home (\w+)", CONTAINER)[1]
    assert words["COPY"].startswith("solidtouch-*.whl ")
    assert words["FROM"].endswith("-slim")


def test_the_page_shows_how_to_use_them():
    """The snippets of GitHub and GitLab are YAML with the inputs of the action."""
    page = (FOLDER / "README.md").read_text(encoding="utf-8")
    github, gitlab = (yaml.safe_load(block) for block in re.findall(r"```yaml\n(.*?)```", page, flags=re.DOTALL))
    (step,) = github

    assert {"action.yml", "Containerfile"} <= set(re.findall(r"\]\((action\.yml|Containerfile)\)", page))
    assert set(step["with"]) <= set(ACTION["inputs"])
    assert {name for name, given in ACTION["inputs"].items() if given.get("required")} <= set(step["with"])
    assert gitlab["conformance"]["artifacts"]["reports"]["junit"] in gitlab["conformance"]["script"][-1]
