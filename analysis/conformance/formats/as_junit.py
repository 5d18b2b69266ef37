"""A report as JUnit XML, as GitHub, GitLab and Jenkins read it: a suite for each level, a test for each case."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any
from xml.etree.ElementTree import Element, SubElement, indent, tostring

_NO_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_COUNTS = {"failures": "differs", "errors": "failed", "skipped": "left out"}
_ELEMENTS = {"differs": "failure", "failed": "error", "left out": "skipped"}


def junit(report: Mapping[str, Any]) -> str:
    """The XML of a report that `report_object` has made."""
    root = Element("testsuites", {"name": report["title"], **_counts(report["cases"])})
    for level in report["levels"]:
        members = [case for case in report["cases"] if case["level"] == level["level"]]
        suite = SubElement(root, "testsuite", {"name": level["level"], **_counts(members)})
        properties = SubElement(suite, "properties")
        for name, value in _properties(report, level).items():
            SubElement(properties, "property", {"name": name, "value": value})
        for case in members:
            _add(suite, case)
    indent(root)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + _NO_XML.sub("?", tostring(root, encoding="unicode")) + "\n"


def _properties(report: Mapping[str, Any], level: Mapping[str, Any]) -> dict[str, str]:
    """What was compared with what, under which conditions, and what the program can claim by it."""
    found = {name: report[name] for name in ("kit", "software", "precision")}
    if report["without"]:
        found["without"] = " ".join(report["without"])
    return found | {"passes": "true" if level["passes"] else "false", "claim": report["sentences"][-1]}


def _counts(cases: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    found = Counter(case["status"] for case in cases)
    return {"tests": str(len(cases)), **{name: str(found[status]) for name, status in _COUNTS.items()}, **_time(cases)}


def _time(cases: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """Seconds of all that have them; a report of answers in files has none."""
    known = [case["seconds"] for case in cases if "seconds" in case]
    return {"time": f"{sum(known):.3f}"} if known else {}


def _add(suite: Element, case: Mapping[str, Any]) -> None:
    names = {"classname": f"conformance.{case['level']}", "name": case["case"]}
    test = SubElement(suite, "testcase", {**names, **_time([case])})
    sentence = case.get("sentence", "")
    if case["status"] == "pass":
        if sentence:
            SubElement(test, "system-out").text = sentence
        return
    tap = f"tap {case['tap']}: " if case.get("tap") else ""
    cause = f"\nlikely cause: {case['about_cause']}" if "about_cause" in case else ""
    result = SubElement(test, _ELEMENTS[case["status"]], {"message": f"{tap}{sentence}"})
    if case["status"] != "left out":  # whose message is the reason
        result.set("type", case["status"])
        about = f"\nwhat it tests: {case['about']}" if "about" in case else ""
        result.text = f"{tap}{sentence}{cause}{about}"  # GitLab shows the text and not the message
