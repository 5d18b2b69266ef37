"""The gallery: every figure of README and docs with its caption, its page, and the command that draws it."""

import re
import tomllib
from pathlib import Path
from typing import NamedTuple

from benchmarks.site.links import ROOT, in_repository

COMMANDS = Path(__file__).parent / "figures.toml"


class Picture(NamedTuple):
    """A figure: its file in the repository, its caption, and the page and nearest heading above it."""

    file: str
    caption: str
    page: str
    heading: str

    @property
    def name(self) -> str:
        """The file without folder and suffix."""
        return Path(self.file).stem


def pictures(pages: list[str]) -> list[Picture]:
    """Figures of pages, each where it is shown first."""
    found: dict[str, Picture] = {}
    for page in pages:
        heading = ""
        for line in (ROOT / page).read_text(encoding="utf-8").splitlines():
            heading = line.lstrip("# ") if line.startswith("#") else heading
            for caption, target in re.findall(r"!\[([^]]*)\]\(([^)]+\.(?:svg|png))\)", line):
                picture = Picture(in_repository(ROOT / page, target), caption, page, heading)
                found.setdefault(picture.file, picture)
    return list(found.values())


def commands() -> dict[str, str]:
    """The command that draws each figure, by its name."""
    return tomllib.loads(COMMANDS.read_text(encoding="utf-8"))


def gallery(known: dict[str, str]) -> str:
    """The page, with links to the staged pages of the repository."""
    drawn_by = commands()
    lines = ["# Gallery", "", "Every figure with the page that explains it and the command that draws it."]
    lines += ["`FOLDER` is a folder of recordings that are not part of this software.", "", "::::{container} gallery"]
    for picture in pictures([name for name in known if name.endswith(".md")]):
        lines += [
            f":::{{figure}} {picture.file.removeprefix('docs/')}",
            f":alt: {picture.caption}",
            "",
            f"**[{picture.heading}]({known[picture.page]})** {picture.caption}.",
            "",
            f"`{drawn_by[picture.name]}`",
            ":::",
            "",
        ]
    return "\n".join([*lines, "::::", ""])
