"""Pages of the public names of `import solidtouch`, which autodoc fills from their docstrings."""

import ast
import inspect
import re
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from types import ModuleType
from typing import Any

import solidtouch

FOLDER = "reference/api"


def names() -> dict[str, Any]:
    """Public names with what they stand for, those of the conformance kit among them."""
    kit = solidtouch.conformance
    return {name: getattr(solidtouch, name) for name in sorted(solidtouch.__all__, key=str.casefold)} | {
        f"conformance.{name}": getattr(kit, name) for name in kit.__all__
    }


def api_pages() -> dict[str, str]:
    """A page for each public name by its staged path; names of the kit are on its page."""
    every = names()
    pages = {}
    for name, thing in every.items():
        if "." in name:
            continue
        inside = [other for other in every if other.startswith(f"{name}.")]
        lines = [f"# {name}", "", "```{eval-rst}", *_directive(name, thing)]
        for other in inside:
            lines += ["", *_directive(other, every[other])]
        pages[f"{FOLDER}/{name}.md"] = "\n".join([*lines, "```", ""])
    return pages


def with_links_to_names(text: str) -> str:
    """The overview of public names, with a link from each row of its first table and a toctree of all pages."""
    every = [name for name in names() if "." not in name]

    def link(found: re.Match[str]) -> str:
        return f"[`{found[1]}`](api/{found[1]}.md)" if found[1] in every else found[0]

    table = re.compile(r"^\| (?=`).*? \|", flags=re.MULTILINE)
    text = table.sub(lambda row: re.sub(r"`(\w+)`", link, row[0]), text)
    listed = "\n".join(f"api/{name}" for name in every)
    return f"{text}\n```{{toctree}}\n:hidden:\n\n{listed}\n```\n"


def _directive(name: str, thing: Any) -> list[str]:
    kind = "autofunction"
    if isinstance(thing, ModuleType):
        kind = "automodule"
    elif inspect.isclass(thing):
        kind = "autoexception" if issubclass(thing, Exception) else "autoclass"
    elif not callable(thing):
        return [f".. py:data:: solidtouch.{name}", "", f"   {_said(name)}"]
    options = ["   :members:"] * (kind == "autoclass")
    return [f".. {kind}:: solidtouch.{name}", *options]


def _said(name: str) -> str:
    """The docstring below a constant, in the module that `__init__.pyi` names."""
    stub = (Path(solidtouch.__file__).parent / "__init__.pyi").read_text(encoding="utf-8")
    (module,) = re.findall(rf"^from \.([\w.]+) import {name} as", stub, flags=re.MULTILINE)
    body = ast.parse(inspect.getsource(import_module(f"solidtouch.{module}"))).body
    for node, below in pairwise(body):
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == name and isinstance(below, ast.Expr):
            return " ".join(ast.literal_eval(below.value).split())
    raise ValueError(f"{name} has no docstring in {module}.")
