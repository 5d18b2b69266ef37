"""Links of a page of the repository, as the site needs them: to other pages, pictures and copies of sources."""

import os
import re
from collections.abc import Callable
from pathlib import Path, PurePosixPath

ROOT = Path(__file__).parents[2]
PICTURES = {".svg", ".png"}
_CODE_OR_LINK = re.compile(r"(?P<code>^```.*?^```$|`[^`\n]*`)|\]\((?P<target>[^)\s]+)\)", re.MULTILINE | re.DOTALL)


def linked(text: str, folder: str, place: Callable[[str], str | None]) -> str:
    """A page whose relative links follow the files to their places on the site.

    Args:
        text: The page, as Markdown.
        folder: Folder of the staged page, relative to that of all staged pages.
        place: Staged path of a target of a link, `None` where the target stays as it is.
    """

    def moved(found: re.Match[str]) -> str:
        target = found["target"]
        path, mark, anchor = (target or "").partition("#")
        staged = place(path) if path and "://" not in path and not path.startswith("mailto:") else None
        if staged is None:
            return found[0]
        return f"]({relative(staged, folder)}{mark}{anchor})"

    return _CODE_OR_LINK.sub(moved, text)


def relative(path: str, folder: str) -> str:
    """A staged path as seen from a folder."""
    return PurePosixPath(os.path.relpath(path, folder or ".")).as_posix()


def in_repository(page: Path, target: str) -> str:
    """Path of a link's target relative to the root of the repository.

    Raises:
        ValueError: There is no such file.
    """
    path = (page.parent / target).resolve()
    if not path.exists():
        raise ValueError(f"{page.relative_to(ROOT)} links to {target}, which does not exist.")
    return path.relative_to(ROOT).as_posix()
