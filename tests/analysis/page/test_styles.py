"""Style sheets hold nothing that no page uses."""

import re
from importlib import resources

import pytest

SHEETS = {
    "reports": ("page", ["page.css"], ["page.html", "page.js"], ""),
    "player": (
        "live",
        ["page/player.css"],
        ["page/player.js", "page/live.js", "fragment.py", "page/colours.js", "widget.py"],
        "st-",
    ),
}


@pytest.mark.parametrize(("package", "sheets", "sources", "prefix"), SHEETS.values(), ids=SHEETS)
def test_every_class_and_variable_of_a_style_sheet_is_used(package, sheets, sources, prefix):
    """Classes by templates and scripts, variables by rules or, as colours of canvases, by name in scripts."""
    folder = resources.files(f"solidtouch.analysis.{package}")
    css, used = ("\n".join(folder.joinpath(name).read_text("utf-8") for name in names) for names in (sheets, sources))
    rules = re.sub(r'"[^"]*"|url\([^)]*\)', "", css)
    classes = {*re.findall(r"\.([a-z][\w-]*)", rules)}
    defined, read = {*re.findall(r"(--[\w-]+):", rules)}, {*re.findall(r"var\((--[\w-]+)", rules)}

    assert len(classes) > 10
    assert [name for name in classes if not re.search(rf"\b(?:{name}|{name.removeprefix(prefix)})\b", used)] == []
    assert [name for name in defined - read if name.removeprefix(f"--{prefix}") not in used] == []
    assert [name for name in read - defined if name not in used] == []
