"""Files of the page, and all of them in one piece for pages and notebooks without a server."""

import re
from functools import cache
from importlib import resources

_KINDS = {
    "html": "text/html; charset=utf-8",
    "css": "text/css; charset=utf-8",
    "js": "text/javascript; charset=utf-8",
    "svg": "image/svg+xml",
}
MODULES = ("colours.js", "canvas.js", "belief.js", "tap.js", "course.js", "player.js")
"""Modules of the player, each after those that it imports."""
PAGE_FILES = ("index.html", "icon.svg", "page.css", "player.css", "live.js", *MODULES)
_IMPORT = re.compile(r"^import [^;]*;\n", flags=re.MULTILINE)
_EXPORT = re.compile(r"^export ", flags=re.MULTILINE)


@cache
def page_file(name: str) -> tuple[bytes, str]:
    """A file of the page and its type."""
    content = resources.files(__package__ or "").joinpath("page", name).read_bytes()
    return content, _KINDS[name.rpartition(".")[2]]


@cache
def script() -> str:
    """All modules of the player as one, which defines `createPlayer`."""
    parts = (page_file(name)[0].decode() for name in MODULES)
    return "\n".join(_EXPORT.sub("", _IMPORT.sub("", part)) for part in parts)


@cache
def style() -> str:
    """Style of the player, which touches nothing outside it."""
    return page_file("player.css")[0].decode()
