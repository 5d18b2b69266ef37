"""The live view as an SVG picture: text without a window frame or fonts to download."""

from io import StringIO

from rich.console import Console
from rich.terminal_theme import DEFAULT_TERMINAL_THEME

from .view import Seen, fitting_width, picture

_WIDEST = 160
_FORMAT = """\
<svg viewBox="0 0 {terminal_width} {terminal_height}" xmlns="http://www.w3.org/2000/svg">
<style>
.{unique_id}-matrix {{ font-family: "DejaVu Sans Mono", Menlo, Consolas, monospace; font-size: {char_height}px; }}
{styles}
</style>
<defs>
<clipPath id="{unique_id}-clip-terminal"><rect width="{terminal_width}" height="{terminal_height}"/></clipPath>
{lines}
</defs>
<rect width="{terminal_width}" height="{terminal_height}" fill="#ffffff"/>
<g clip-path="url(#{unique_id}-clip-terminal)">
{backgrounds}
<g class="{unique_id}-matrix">
{matrix}
</g>
</g>
</svg>
"""


def live_picture(seen: Seen) -> str:
    """One step of the live view as SVG."""
    console = Console(
        record=True,
        width=min(fitting_width(seen.grid), _WIDEST),
        file=StringIO(),
        force_terminal=True,
        color_system="truecolor",
    )
    console.print(picture(seen, console.width))
    return console.export_svg(theme=DEFAULT_TERMINAL_THEME, code_format=_FORMAT, unique_id="solidtouch")
