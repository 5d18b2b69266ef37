"""The kit as a data set: its version, checksums, licence, provenance and descriptions."""

import hashlib
import json
import re
import shutil
import subprocess
import time
import tomllib
from importlib.metadata import version
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest
from solidtouch.analysis.conformance.catalogue import catalogue
from solidtouch.analysis.conformance.dataset import pinned
from solidtouch.analysis.conformance.dataset.export import STATIC
from solidtouch.analysis.conformance.dataset.fingerprints import FINGERPRINTS, fingerprint
from solidtouch.analysis.conformance.dataset.version import KIT_VERSION, RELEASED

import solidtouch as st

FROZEN = Path(__file__).parent / "older" / "cases.txt"
"""Each case of the kit, the version that added it, and the start of the checksum of it and its answers."""
CC0 = "https://creativecommons.org/publicdomain/zero/1.0/"
ROOT = Path(__file__).parents[3]


def read(exported, name):
    return json.loads((exported / name).read_text(encoding="utf-8"))


def frozen():
    """Version and checksum by case."""
    lines = (line.split() for line in FROZEN.read_text().splitlines())
    return {name: (kit, digest) for name, kit, digest in lines}


def test_a_version_holds_the_same_cases_and_answers(exported):
    """Provenance may differ."""
    found = {}
    for name in catalogue():
        case = read(exported, f"{name}.json")
        del case["provenance"]
        found[name] = hashlib.sha256(json.dumps(case, sort_keys=True).encode()).hexdigest()[:16]
    kept = frozen()
    changed = [name for name in kept if found.get(name) != kept[name][1]]
    added = [f"{name} {KIT_VERSION} {digest}" for name, digest in found.items() if name not in kept]

    assert not changed, f"Cases or answers that users pinned would change, which takes a new major version: {changed}"
    assert not added, (
        "New cases take a new minor KIT_VERSION, with RELEASED and an entry in CHANGELOG.md of the kit. "
        f"Then append what this test prints to {FROZEN.relative_to(ROOT)}:\n" + "\n".join(added)
    )


def test_fingerprints_are_those_of_the_cases(exported, tmp_path, monkeypatch):
    """So that a folder of this version holds them and no others."""
    monkeypatch.setattr(pinned, "KIT_VERSION", "0.0.0")  # of another version, none is compared
    st.conformance.export(tmp_path / "single", precision="single")
    double, single = (pinned.read_kit(folder).cases for folder in (exported, tmp_path / "single"))
    found = {
        name: [case.level, fingerprint(case), None if single[name].absent else fingerprint(single[name])]
        for name, case in double.items()
    }
    text = "{\n" + ",\n".join(f"{json.dumps(name)}: {json.dumps(parts)}" for name, parts in found.items()) + "\n}\n"
    path = Path(pinned.__file__).with_name(FINGERPRINTS)
    old = path.read_text().splitlines()

    assert path.read_text() == text, (
        f"{path.relative_to(ROOT)} must have these lines; a change of an old case takes a new major version:\n"
        + "\n".join(line for line in text.splitlines() if line not in old)
    )


def test_the_changelog_has_every_version_and_this_one_first(exported):
    entries = re.findall(r"^## (\S+) \((\S+)\)$", (exported / "CHANGELOG.md").read_text(), flags=re.MULTILINE)

    assert entries[0] == (KIT_VERSION, RELEASED)
    assert {kit for kit, _ in frozen().values()} <= {number for number, _ in entries}


def test_an_export_has_the_same_bytes_each_time(tmp_path, monkeypatch):
    """Also on another day."""
    names = ("root-j", "episode-paper-size")
    st.conformance.export(tmp_path / "one", names)
    now = time.time()
    monkeypatch.setattr(time, "time", lambda: now + 1e6)
    st.conformance.export(tmp_path / "two", names)
    one, two = ({path.name: path.read_bytes() for path in (tmp_path / name).iterdir()} for name in ("one", "two"))

    assert one == two
    with ZipFile(tmp_path / "one" / "episode-paper-size.npz") as arrays:
        assert {entry.date_time[0] for entry in arrays.infolist()} == {1980}
        assert {entry.compress_type for entry in arrays.infolist()} == {0}


HIDDEN = ".gitattributes"


def test_checksums_are_those_of_all_files(exported):
    """As `sha256sum -c` reads them, where it is installed."""
    lines = [line.split("  ") for line in (exported / "SHA256SUMS").read_text().splitlines()]

    assert {name for _, name in lines} == {path.name for path in exported.iterdir()} - {"SHA256SUMS", HIDDEN}
    assert all(hashlib.sha256((exported / name).read_bytes()).hexdigest() == right for right, name in lines)
    if tool := shutil.which("sha256sum"):
        subprocess.run([tool, "--check", "--quiet", "--strict", "SHA256SUMS"], cwd=exported, check=True)


def test_every_case_says_where_its_answers_come_from(exported):
    for name in catalogue():
        found = read(exported, f"{name}.json")["provenance"]
        assert found["method"]
        assert found | {"method": ""} == {
            "kit": KIT_VERSION,
            "program": "solidtouch",
            "program_version": version("solidtouch"),
            "method": "",
            "library": "mpmath",
            "library_version": version("mpmath"),
            "digits": 60,
        }
    assert read(exported, "index.json")["provenance"] == found
    with np.load(exported / "episode-paper-size.npz") as arrays:
        assert {key: arrays[f"provenance_{key}"].item() for key in found} == found


def test_the_kit_is_public_domain_and_the_program_is_not(exported):
    """Both are said where a reader looks for them."""
    text = (exported / "LICENSE").read_text()

    assert text.startswith("Creative Commons Legal Code\n\nCC0 1.0 Universal")
    assert "waives, abandons, and surrenders" in " ".join(text.split())
    assert read(exported, "index.json")["license"] == "CC0-1.0"
    assert tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["license"] == "Apache-2.0"
    for page in (exported / "README.md", ROOT / "docs" / "reference" / "conformance" / "README.md"):
        assert {"CC0", "Apache-2.0"} <= set(re.findall(r"CC0|Apache-2\.0", page.read_text(encoding="utf-8")))


def test_the_readme_of_the_kit_names_its_files(exported):
    named = set(re.findall(r"`([\w.*-]*\.\w+|LICENSE|SHA256SUMS)`", (exported / "README.md").read_text()))
    patterns = [name.replace("NAME", "*") for name in named]

    assert [path.name for path in exported.iterdir() if not any(path.match(pattern) for pattern in patterns)] == [
        "README.md"
    ]


def test_the_description_is_an_ro_crate(exported):
    """As version 1.1 has it: descriptor, root with all that it must have, files linked from it, no loose reference."""
    whole = read(exported, "ro-crate-metadata.json")
    graph = {entity["@id"]: entity for entity in whole["@graph"]}
    descriptor, root = graph["ro-crate-metadata.json"], graph["./"]

    assert whole["@context"] == "https://w3id.org/ro/crate/1.1/context"
    assert len(graph) == len(whole["@graph"])
    assert all({"@id", "@type", "name"} <= set(entity) for entity in graph.values() if entity is not descriptor)
    assert descriptor["@type"] == "CreativeWork"
    assert descriptor["about"] == {"@id": "./"}
    assert descriptor["conformsTo"] == {"@id": "https://w3id.org/ro/crate/1.1"}
    assert root["@type"] == "Dataset"
    assert root["description"]
    assert (root["version"], root["datePublished"], root["license"]) == (KIT_VERSION, RELEASED, {"@id": CC0})
    parts = {part["@id"] for part in root["hasPart"]}
    assert parts == {path.name for path in exported.iterdir()} - {"SHA256SUMS", HIDDEN, "ro-crate-metadata.json"}
    for part in parts:
        assert graph[part]["@type"] == "File"
        assert graph[part]["contentSize"] == str((exported / part).stat().st_size)
    assert {entity["@id"] for entity in references(whole["@graph"])} - {descriptor["conformsTo"]["@id"]} <= set(graph)
    made = graph["#exact-answers"]
    assert [graph[tool["@id"]]["softwareVersion"] for tool in made["instrument"]] == [
        version("solidtouch"),
        version("mpmath"),
    ]


def references(thing):
    """Objects that hold an identifier alone, wherever they stand."""
    parts = thing.values() if isinstance(thing, dict) else thing if isinstance(thing, list) else ()
    if isinstance(thing, dict) and set(thing) == {"@id"}:
        yield thing
    for part in parts:
        yield from references(part)


def test_the_description_is_croissant(exported):
    """As version 1.0 has it: what is required and recommended, files with checksums, fields that are there."""
    whole = read(exported, "croissant.json")
    context = whole["@context"]
    files = {file["@id"]: file for file in whole["distribution"]}
    (records,) = whole["recordSet"]

    assert (context["@vocab"], context["cr"]) == ("https://schema.org/", "http://mlcommons.org/croissant/")
    assert whole["@type"] == "sc:Dataset"
    assert (context["conformsTo"], whole["conformsTo"]) == ("dct:conformsTo", "http://mlcommons.org/croissant/1.0")
    assert (whole["version"], whole["datePublished"], whole["license"]) == (KIT_VERSION, RELEASED, CC0)
    assert {"name", "description", "url", "creator", "keywords", "citeAs"} <= set(whole)
    assert set(files) == {path.name for path in exported.iterdir()} - {
        "SHA256SUMS",
        HIDDEN,
        "croissant.json",
        "ro-crate-metadata.json",
    }
    for name, file in files.items():
        assert file["@type"] == "cr:FileObject"
        assert file["contentUrl"] == file["name"] == name
        assert file["sha256"] == hashlib.sha256((exported / name).read_bytes()).hexdigest()
        assert file["encodingFormat"]
    for field in records["field"]:
        assert field["source"]["fileObject"] == {"@id": "index.json"}
        name = re.fullmatch(r"\$\.cases\[\*\]\.(\w+)", field["source"]["extract"]["jsonPath"])[1]
        kinds = {"sc:Text": str, "sc:Integer": int}
        assert all(isinstance(case[name], kinds[field["dataType"]]) for case in read(exported, "index.json")["cases"])
    assert records["key"]["@id"] in {field["@id"] for field in records["field"]}


@pytest.mark.parametrize(
    ("tool", "words"),
    [
        ("mlcroissant", "validate --jsonld croissant.json"),
        ("rocrate-validator", "--no-interactive validate --no-paging --profile-identifier ro-crate-1.1 ."),
    ],
)
def test_programs_of_others_find_the_descriptions_valid(exported, tool, words):
    """Of the packages mlcroissant and roc-validator; the second fetches the terms of RO-Crate."""
    if (program := shutil.which(tool)) is None:
        pytest.skip(f"there is no {tool}")
    done = subprocess.run([program, *words.split()], cwd=exported, capture_output=True, text=True, check=False)
    said = done.stdout + done.stderr
    if "URLError" in said or "Unable to retrieve" in said:
        pytest.skip(f"{tool} cannot fetch what it needs")

    assert done.returncode == 0, said


@pytest.mark.parametrize("name", sorted(STATIC))
def test_files_of_the_package_are_exported_as_they_are(exported, name):
    text = (exported / name).read_bytes()

    assert text.endswith(b"\n")
    assert b"\r" not in text
    assert text == (ROOT / "analysis" / "conformance" / "dataset" / name).read_bytes()
