"""Where labels stand: in columns and arrays, in the names of files, in tables beside them."""

from typing import Any, NamedTuple

from numpy.typing import NDArray

from .formats.registry import ENDINGS, ending

type Label = NDArray[Any] | str | float | ByOrder
"""One value for each tap or row, or the same for all."""


class ByOrder(NamedTuple):
    """Values of all taps of a recording in their order, from a table."""

    values: NDArray[Any]
    table: str


class LabelSource(NamedTuple):
    """Where a label stands.

    Attributes:
        key: Which label.
        kind: `"column"`, `"field"`, `"table"`, `"constant"`, `"file"`, `"gap"`, `"date"` of a column, or `"day"`, a
            field with a date.
        name: Of the column, field or table, or the constant itself.
        column: Of a table.
    """

    key: str
    kind: str
    name: str
    column: str = ""


def label_source(key: str, text: str) -> LabelSource:
    """Where a label stands, from the text of a map."""
    begin, _, rest = text.partition(":")
    kinds = {"column": "column", "file": "field", "folder": "field"}
    kinds |= {"gap": "gap", "date": "date"} if key == "session" else {}
    if text.startswith("="):
        return LabelSource(key, "constant", text[1:])
    if begin == "date" and key == "session" and (rest.startswith(("file:", "folder:")) or rest == "{session}"):
        return LabelSource(key, "day", "session")
    if rest and begin in kinds:
        return LabelSource(key, kinds[begin], key if kinds[begin] == "field" else rest)
    if text == "file" and key in ("session", "trial"):
        return LabelSource(key, "file", "")
    head, _, column = text.rpartition(":")
    for name, wanted in ((text, ""), (head, column)):
        if ENDINGS.get(ending(name)) in ("text", "npy"):
            return LabelSource(key, "table", name, wanted)
    return LabelSource(key, "column", text)
