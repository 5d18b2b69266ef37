"""Docstrings for autodoc: single backticks are code, public names and pages of docs are links."""

import re
from typing import Any

from benchmarks.site.api import names

_CODE = re.compile(r"(?<![`:\w])`([^`]+)`(?![`_])")
_PAGE = re.compile(r"\bdocs/([\w/-]+)\.md")


def prepare(app: Any, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:  # noqa: ARG001 - called by Sphinx
    """Rewrites the lines of a docstring in place."""
    lines[:] = [_line(line) for line in lines]


def skips(app: Any, what: str, name: str, thing: Any, skip: bool, options: Any) -> bool | None:  # noqa: ARG001 - called by Sphinx
    """Leaves out fields that their class describes, those of named tuples and records, and what scikit-learn adds."""
    left_out = {"_tuplegetter", "member_descriptor"}
    return True if type(thing).__name__ in left_out or re.fullmatch("set_\\w+_request", name) else None


def _line(line: str) -> str:
    """A line, unless it is an example."""
    if line.lstrip().startswith((">>>", "...")):
        return line
    return _PAGE.sub(_page, _CODE.sub(_code, line))


def _code(found: re.Match[str]) -> str:
    return f":py:obj:`~solidtouch.{found[1]}`" if found[1] in names() else f"``{found[1]}``"


def _page(found: re.Match[str]) -> str:
    return f":doc:`/{found[1].replace('README', 'index')}`"
