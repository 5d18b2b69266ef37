"""A comparison of strategies in the terminal."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ..page.numbers import interval
from .findings import FIXED, TAPS

if TYPE_CHECKING:
    from rich.console import Console


def render(summary: Mapping[str, Any], console: "Console") -> None:
    """Prints the findings, and for each kind of data the differences after equal numbers of taps."""
    for sentence in summary["findings"]:
        console.print(sentence, highlight=False)
    for source in summary["sources"]:
        console.print(f"[bold]{source['name']}[/bold]", highlight=False)
        for sentence in source["findings"]:
            console.print(sentence, highlight=False)
        console.print(_differences(source))


def _differences(source: Mapping[str, Any]) -> Any:
    from rich import box  # noqa: PLC0415
    from rich.table import Table  # noqa: PLC0415

    title = f"Object error ({source['what_unit']}) less that of the fixation point after n taps"
    table = Table(title=title, title_justify="left", box=box.SIMPLE, padding=(0, 1, 0, 0))
    table.add_column("strategy", no_wrap=True)
    for taps in TAPS:
        table.add_column(f"{taps} taps", justify="right")
    rows = source["powers"][0]["equal"][FIXED]
    for name in source["strategies"]:
        own = [row for row in rows if row["strategy"] == name]
        table.add_row(name, *(interval(row, "what_error_difference") for row in own))
    return table
