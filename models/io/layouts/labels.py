"""Where labels stand: in columns and arrays, in the names of files, in tables beside them."""

from typing import Any, Literal, NamedTuple

from numpy.typing import NDArray

from .formats.registry import ENDINGS, ending

type Label = NDArray[Any] | str | float | ByOrder
"""One value for each tap or row, or the same for all."""


class ByOrder(NamedTuple):
    """Values of all taps of some files in their order.

    Attributes:
        values: The values.
        table: The table or array, for messages.
        place: The file and array or column, which tells tables of one name apart.
        rows: Which of its rows they are, the same for all files that share them.
        hint: What is said where there are more or fewer values than taps.
        doubt: `"rows"` if the table should be read in another way, `"files"` if it should where each file is a tap.
    """

    values: NDArray[Any]
    table: str
    place: tuple[str, str]
    rows: tuple[int, ...] = ()
    hint: str = ""
    doubt: Literal["", "files", "rows"] = ""


_TABLES = ("text", "npy", "jsonl", "parquet", "arrow")
"""Formats of tables of labels."""
LISTS = ("what_names", "where_values")
"""Keys of names and positions that labels index."""


class LabelSource(NamedTuple):
    """Where a label stands.

    Attributes:
        key: Which label.
        kind: `"column"`, `"field"`, `"table"`, `"constant"`, `"file"` or `"gap"`.
        name: Of the column, field or table, or the constant itself.
        column: Of a table.
        by: Column of a table that tells which row is whose, `"order"`, or empty.
        own: Column, array or field of the recording that this one is compared with.
        dated: Whether the values are dates, of which each is a session.
    """

    key: str
    kind: str
    name: str
    column: str = ""
    by: str = ""
    own: str = ""
    dated: bool = False


def label_source(key: str, text: str) -> LabelSource:
    """Where a label stands, from the text of a map."""
    begin, _, rest = text.partition(":")
    if begin == "date" and rest and key == "session":
        found = LabelSource(key, "field", key) if rest == "{session}" else label_source(key, rest)
        return found._replace(dated=True)
    kinds = {"column": "column", "file": "field", "folder": "field"} | ({"gap": "gap"} if key == "session" else {})
    if text.startswith("="):
        return LabelSource(key, "constant", text[1:])
    if rest and begin in kinds:
        return LabelSource(key, kinds[begin], key if kinds[begin] == "field" else rest)
    if text == "file" and key in ("session", "trial"):
        return LabelSource(key, "file", "")
    parts = text.split(":")
    for number in range(1, len(parts) + 1):
        kind = ENDINGS.get(ending(name := ":".join(parts[:number])))
        if kind in _TABLES or (name.endswith(".json") and key in LISTS):
            column, _, by = ":".join(parts[number:]).partition(":")
            by, _, own = by.partition("=")
            return LabelSource(key, "table", name, column, by, own)
    return LabelSource(key, "column", text)
