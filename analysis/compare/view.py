"""A comparison as a table in the terminal."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ..page.page import interval, number

if TYPE_CHECKING:
    from rich.console import Console


def render(summary: Mapping[str, Any], console: "Console") -> None:
    """Prints ranks and values of all models, and what was found."""
    from rich import box  # noqa: PLC0415
    from rich.table import Table  # noqa: PLC0415

    table = Table(
        title="Ranks, with what each level is ranked by", title_justify="left", box=box.SIMPLE, padding=(0, 1, 0, 0)
    )
    table.add_column("model", no_wrap=True)
    for level in summary["levels"]:
        table.add_column(level["title"] + (f"\n({level['unit']})" if level["unit"] else ""), justify="right")
    for row in summary["ranks"]:
        table.add_row(row["name"], *(_cell(cell) for cell in row["levels"]))
    console.print(table)
    taps = [row for row in summary["taps"] if "integrated" in row]
    if taps:
        console.print(_taps(taps, summary["reference"]))
    for sentence in summary["findings"]:
        console.print(f"- {sentence}", highlight=False)
    for row in summary["refused"]:
        console.print(f"Left out: {row['name']}. {row['reason']}", highlight=False)
    for sentence in summary["warnings"]:
        console.print(f"Warning: {sentence}", highlight=False)


def _taps(rows: list[Mapping[str, Any]], reference: str) -> Any:
    from rich import box  # noqa: PLC0415
    from rich.table import Table  # noqa: PLC0415

    table = Table(
        title="Log probability of taps of a session left out (nat per tap) [95 % interval]",
        title_justify="left",
        box=box.SIMPLE,
        padding=(0, 1, 0, 0),
    )
    for heading in ("model", "integrated", f"less {reference}", "plug-in", "weight"):
        table.add_column(heading, justify="left" if heading == "model" else "right", overflow="fold")
    for row in rows:
        difference = {end: row.get(f"integrated_difference{end[1:]}") for end in ("d", "d_low", "d_high")}
        table.add_row(
            row["name"],
            interval(row, "integrated"),
            interval(difference, "d"),
            number(row.get("plug_in"), 4),
            f"{row['weight']:.2f}" if "weight" in row else "–",
        )
    return table


def _cell(cell: Mapping[str, Any] | None) -> str:
    return "–" if cell is None else f"{cell['rank']}  {number(cell['value'])}"
