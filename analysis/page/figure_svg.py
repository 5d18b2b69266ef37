"""SVG as matplotlib writes it, with the same look in half the bytes."""

import re
from collections.abc import Collection
from re import Match

_SHAPE = r'<(?:path d="[^"]*"|use xlink:href="[^"]*" x="[^"]*" y="[^"]*")'
_IN_A_ROW = re.compile(rf'{_SHAPE}( [^>]*style="(?!opacity)(?:(?!;opacity)[^"])*")/>(?:\n{_SHAPE}\1/>)+')


def shortened(svg: bytes, kept: Collection[str]) -> bytes:
    """The same drawing with places in hundredths of a point, and without what shows nothing.

    Args:
        svg: The SVG.
        kept: Ids that stay though nothing in it refers to them.
    """
    text = re.sub(r"<!--.*?-->", "", svg.decode(), flags=re.DOTALL)
    text = re.sub(r"\n\s*", "\n", text).replace("*{", "svg{")  # inherited, also from groups
    text = re.sub(r'(?<= [dxy]=")[^"]*|(?<=translate\()[^)]*', _rounded, text)
    text = re.sub(r'(?<= d=")[^"]*', _path, text).replace("DejaVuSans-", "D")
    text = re.sub(r'(<use [^>]*) transform="translate\((\S+) 0\)"', r'\1 x="\2"', text)
    text = re.sub(r'(?<= style=")[^"]*', lambda style: re.sub(r"([:;]) ", r"\1", style[0]), text)
    used = {*re.findall(r'#([^")]+)', text), *kept}
    text = re.sub(r' id="([^"]*)"', lambda name: name[0] if name[1] in used else "", text)
    return _without_groups(_IN_A_ROW.sub(_together, _without_strokes(text))).encode()


def _rounded(numbers: Match[str]) -> str:
    return re.sub(r"-?\d+\.\d{3,}", lambda one: f"{float(one[0]):.2f}".rstrip("0").rstrip("."), numbers[0])


def _path(path: Match[str]) -> str:
    """A path with one coordinate for lines along the axes."""
    x = y = ""
    found: list[str] = []
    for command, numbers in re.findall(r"([A-Za-z])\s*([^A-Za-z]*)", path[0]):
        *_, to_x, to_y = "", "", *numbers.split()
        level, upright = to_y == y, to_x == x
        line = f"H{to_x}" if level else f"V{to_y}" if upright else ""
        found.append((line if command == "L" else "") or command + numbers.strip())
        x, y = to_x, to_y
    return "".join(found)


def _without_strokes(text: str) -> str:
    """Marks without strokes that the shapes that they refer to have themselves."""
    own = {*re.findall(r'<path id="([^"]*)" d="[^"]*" style=', text)}

    def mark(use: Match[str]) -> str:
        return re.sub(';?stroke[^;"]*', "", use[0]).replace(' style=""', "") if use[1] in own else use[0]

    return re.sub(r'<use xlink:href="#([^"]*)"[^>]*>', mark, text)


def _together(shapes: Match[str]) -> str:
    """Shapes in a row with the same style as a group that has it; opacity would be that of the group as a whole."""
    return f"<g{shapes[1]}>\n{shapes[0].replace(shapes[1], '')}\n</g>"


def _without_groups(text: str) -> str:
    """Without groups that say nothing."""
    plain: list[bool] = []

    def tag(found: Match[str]) -> str:
        end, says, alone = found.groups()
        if not end and not alone:
            plain.append(not says)
        return "" if (plain.pop() if end else not says) else found[0]

    return re.sub(r"\n+", "\n", re.sub(r"<(/?)g\b([^>]*?)(/?)>", tag, text))
