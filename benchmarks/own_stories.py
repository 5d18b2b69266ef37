"""The models of docs/how-to/your-own-model.md, taken from the page itself."""

import ast
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

PAGE = Path(__file__).parents[1] / "docs" / "how-to" / "your-own-model.md"


def code() -> str:
    """A file of models: imports and functions of the page, without the calls that it shows."""
    blocks = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    parts = [
        str(ast.get_source_segment(block, node))
        for block in blocks
        for node in ast.parse(block).body
        if isinstance(node, ast.Import | ast.FunctionDef)
    ]
    return "\n\n".join(parts) + "\n"


def stories() -> dict[str, Callable[..., Any]]:
    """The functions by name: laplace, two_levels, walk, shifted."""
    names: dict[str, Any] = {}
    exec(code(), names)  # noqa: S102 - code of this repository
    functions = [node.name for node in ast.parse(code()).body if isinstance(node, ast.FunctionDef)]
    return {name: names[name] for name in functions}
