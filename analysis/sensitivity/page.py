"""The folder of a sensitivity study: figures, `sensitivity.json` and the page."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from ...models.storage import complete_folder
from ..page.old import DrawnPicture as Picture
from ..page.old import write_page
from . import figures


def write_sensitivity(folder: Path, summary: Mapping[str, Any], force: bool = False) -> None:
    """Writes everything, whole or not at all.

    Args:
        folder: Where to.
        summary: See `summary.summarise`.
        force: Whether files in an existing folder may be replaced.

    Raises:
        InputError: The folder cannot be written.
    """
    with complete_folder(folder, force) as temporary:
        write_page(temporary, "sensitivity.html", summary, pictures(summary), "sensitivity.json")


def pictures(summary: Mapping[str, Any]) -> Iterator[Picture]:
    """The figures of each source, `forest-N` and `pairs-N`, counted from 1."""
    for number, source in enumerate(summary["sources"], 1):
        yield Picture(
            f"forest-{number}",
            f"What every option is worth: {source['name']}",
            f"Changes against the default (in brackets), {source['policies'][-1]} perception, choices by the object "
            "error of their strongest option. Thick lines are 95 % intervals, thin ones hold all together; changes in "
            "the grey bands do not matter. Axes are linear in the bands and logarithmic beyond.",
            figures.forest(source),
        )
        pairs = figures.interactions(source)
        if pairs is not None:
            yield Picture(
                f"pairs-{number}",
                f"Pairs of the strongest options: {source['name']}",
                "Change of the object error by both options beyond the sum of what each changes, with 95 % intervals; "
                "bold where all intervals together exclude zero. Below zero both together change less than the sum, as "
                "where errors cannot get much worse than chance; above zero they change more. Colours are linear up "
                "to the change that does not matter and logarithmic beyond.",
                pairs,
            )
