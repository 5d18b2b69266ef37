"""Gives the package its description for an index: README.md, whose relative links would be dead there.

With an address `Source` under `[project.urls]` they lead to the files of the version's tag; without one, pictures are
left out and links become their text. All else is in pyproject.toml.
"""

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parent
_LINK = r"(`+[^`]+`+)|(!?)\[((?:[^][]|\[[^][]*\])*)\]\(([^)\s]+)\)"  # code first, in which nothing is a link


def description(readme: str, source: str = "", tag: str = "") -> str:
    """The README for an index.

    Args:
        readme: Markdown with relative links.
        source: Address of the repository, empty if there is none.
        tag: Tag of the version in it.
    """

    def pointed(link: re.Match[str]) -> str:
        code, picture, text, target = link.groups()
        if code:
            return code
        text = re.sub(_LINK, pointed, text)  # a picture may be what is clicked
        if re.match("#|[a-z]+:", target):
            return f"{picture}[{text}]({target})"
        if source:
            return f"{picture}[{text}]({source}/{'raw' if picture else 'blob'}/{tag}/{target})"
        return "" if picture else text

    parts = re.split(r"(^```.*?^```$)", readme, flags=re.MULTILINE | re.DOTALL)
    parts[::2] = [re.sub(_LINK, pointed, part) for part in parts[::2]]  # the others are code
    return re.sub(r"\n{3,}", "\n\n", "".join(parts))


if __name__ == "__main__":
    from setuptools import setup

    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    setup(
        long_description=description(
            (ROOT / "README.md").read_text(encoding="utf-8"),
            project.get("urls", {}).get("Source", ""),
            f"v{project['version']}",
        ),
        long_description_content_type="text/markdown",
    )
