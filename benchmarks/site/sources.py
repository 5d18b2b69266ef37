"""Pages that show files and folders of the repository which the documentation links to."""

import ast
import os
from pathlib import Path

from benchmarks.site.links import ROOT, relative

_LANGUAGES = {".py": "python", ".toml": "toml", ".sh": "bash", ".c": "c", ".js": "javascript", ".cff": "yaml"}


def source_place(name: str) -> str:
    """Staged path of the page of a file or folder."""
    return f"source/{name}.md"


def source_page(name: str, known: set[str], folder: Path) -> str:
    """The page of a file or folder.

    Args:
        name: Its path in the repository.
        known: All files and folders that have such a page.
        folder: Where the pages are staged.
    """
    path = ROOT / name
    if path.is_dir():
        return _folder_page(path, name, known)
    here = (folder / source_place(name)).parent
    language = _LANGUAGES.get(path.suffix, "text")
    included = os.path.relpath(path, here)
    return f"# {name}\n\n```{{literalinclude}} {included}\n:language: {language}\n:linenos:\n```\n"


def _folder_page(path: Path, name: str, known: set[str]) -> str:
    head = path / "__init__.py"
    lines = [f"# {name}/", ""]
    if head.exists():
        lines += [_docstring(head), ""]
    for part in sorted(path.iterdir()):
        if part.name.startswith((".", "_")) or part.suffix in {".pyc", ".egg-info"}:
            continue
        own = part.relative_to(ROOT).as_posix()
        label = f"`{part.name}{'/' if part.is_dir() else ''}`"
        shown = f"[{label}]({relative(source_place(own), f'source/{Path(name).parent.as_posix()}')})"
        lines.append(f"- {shown if own in known else label}{_first_line(part)}")
    return "\n".join([*lines, ""])


def _first_line(path: Path) -> str:
    """First line of the docstring of a module or package, after a colon; empty for others."""
    file = path / "__init__.py" if path.is_dir() else path
    if file.suffix != ".py" or not file.exists():
        return ""
    line = _docstring(file).split("\n")[0]
    return f": {line}" if line else ""


def _docstring(file: Path) -> str:
    return ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""
