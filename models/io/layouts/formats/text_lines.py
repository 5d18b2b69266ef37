"""Lines of a text file in blocks: decoded, without comments, and split into cells where a delimiter is."""

import csv
import re
from collections import deque
from collections.abc import Iterable, Iterator
from io import StringIO
from pathlib import Path
from typing import IO, NamedTuple

from ....errors import InputError

BLOCK = 1 << 22
"""Bytes that are read at a time."""
_LONGEST = 16  # times the size of a block may be that of a row
DELIMITERS = {",": ",", ";": ";", "tab": "\t", "|": "|", "blank": " "}
_MOST_BLOCKS = 4
csv.field_size_limit(_MOST_BLOCKS * BLOCK)  # a cell may hold a list of all samples of a tap
_BLANKS = re.compile(r'("[^"]*")|[ \t]+')
_QUOTED = rb'"[^"]*"'
_MARKS = {b"\xff\xfe": "utf-16-le", b"\xfe\xff": "utf-16-be", b"\xef\xbb\xbf": "utf-8"}


class TextBlock(NamedTuple):
    """Some whole lines of a file.

    Attributes:
        line: Number of the first one, from 1.
        content: They in UTF-8, each with a line feed at its end; comments are left out.
        ended: Whether the last line has an end in the file.
    """

    line: int
    content: bytes
    ended: bool = True

    @property
    def quotes(self) -> bool:
        """Whether a cell may be quoted."""
        return b'"' in self.content


class Lines:
    """Lines of a text file in UTF-8, UTF-16 with a byte order mark, or else that of Windows, after those skipped.

    Line ends are those of any system. The first 4 MiB tell whether a file without a byte order mark is UTF-8.

    Args:
        path: The file.
        skip: Number of lines to skip.
        comment: What begins a comment, to the end of its line; empty for none.
        size: Bytes that are read at a time.

    Raises:
        InputError: The file cannot be read or is not text.
    """

    def __init__(self, path: Path, skip: int, comment: str, size: int = BLOCK) -> None:
        self.path, self.skip, self.size = path, skip, size
        self._comment = re.compile(b"(%s)|%s[^\n]*" % (_QUOTED, re.escape(comment.encode()))) if comment else None
        self._mark = comment.encode()
        with self._opened() as file:
            begin = file.read(BLOCK)
        mark = next((mark for mark in _MARKS if begin.startswith(mark)), b"")
        self._begin, self._encoding = len(mark), _MARKS.get(mark, "utf-8" if _is_utf8(begin) else "cp1252")
        if b"\0" in begin and not self._encoding.startswith("utf-16"):
            raise InputError("not a text table: it holds zero bytes; UTF-16 needs a byte order mark.")

    def __iter__(self) -> Iterator[TextBlock]:
        """Blocks of whole lines; one that ends within a quoted cell may be split there."""
        line, rest = 1, b""
        with self._opened() as file:
            file.seek(self._begin)
            while read := file.read(self.size):
                content = rest + self._utf8(read, file, line)
                if len(read) < self.size:  # the end of the file
                    rest = content
                    break
                end = max(content.rfind(b"\n"), content.rfind(b"\r", 0, -1)) + 1
                content, rest = content[:end], content[end:]
                if len(rest) > _LONGEST * BLOCK:
                    raise InputError(f"line {line}: longer than {_LONGEST * BLOCK >> 20} MiB; not a text table.")
                if content:
                    block = TextBlock(line, _line_feeds(content))
                    yield from self._kept(block)
                    line += block.content.count(b"\n")
        if rest:
            content = _line_feeds(rest)
            yield from self._kept(TextBlock(line, content.removesuffix(b"\n") + b"\n", content.endswith(b"\n")))

    def _opened(self) -> IO[bytes]:
        try:
            return self.path.open("rb")
        except OSError as error:
            raise InputError(f"cannot read: {error.strerror}.") from error

    def _utf8(self, read: bytes, file: IO[bytes], line: int) -> bytes:
        """Bytes of a file in UTF-8, with as many more as the last character needs."""
        if self._encoding == "cp1252":
            return read if read.isascii() else from_windows(read)
        if self._encoding == "utf-8" and read.isascii():
            return read
        for _ in range(4):  # a character has up to four bytes
            try:
                return read.decode(self._encoding).encode()
            except UnicodeDecodeError as error:
                if error.end < len(read) or not (more := file.read(1)):
                    line += read[: error.start].decode(self._encoding, "replace").count("\n")
                    raise InputError(f"line {line}: not {self._encoding[:6].upper().rstrip('-')} text.") from error
                read += more
        raise InputError(f"line {line}: not text.")

    def _kept(self, block: TextBlock) -> Iterator[TextBlock]:
        """A block without comments, and without the lines that are skipped."""
        skipped = max(0, self.skip - block.line + 1)
        line, content, ended = block
        if skipped:
            parts = content.split(b"\n", skipped)
            line, content = line + len(parts) - 1, parts[-1]
        if self._comment and self._mark in content:
            content = self._comment.sub(rb"\1", content)
        if content:
            yield TextBlock(line, content, ended)


def from_windows(content: bytes) -> bytes:
    """Text of Windows, or where that has no such characters of Latin-1, in UTF-8."""
    try:
        return content.decode("cp1252").encode()
    except UnicodeDecodeError:
        return content.decode("latin-1").encode()


def _is_utf8(begin: bytes) -> bool:
    """Whether the beginning of a file is, but for a character that ends after it."""
    try:
        begin.decode()
    except UnicodeDecodeError as error:
        return error.reason == "unexpected end of data" and len(begin) == BLOCK
    return True


def _line_feeds(content: bytes) -> bytes:
    return content.replace(b"\r\n", b"\n").replace(b"\r", b"\n") if b"\r" in content else content


def with_one_delimiter(content: bytes, others: Iterable[str], delimiter: str) -> bytes:
    """Text with one delimiter in place of others; those in quoted cells stay."""
    signs = b"|".join(re.escape(other.encode()) for other in others)
    one = delimiter.encode()
    return re.sub(b"(%s)|%s" % (_QUOTED, signs), lambda found: found[1] or one, content)


class OpenQuote(InputError):
    """A quoted cell does not end.

    Args:
        line: Where its row begins.
    """

    def __init__(self, line: int) -> None:
        super().__init__(f"line {line}: a quoted cell does not end.")
        self.line = line


def whole_rows(blocks: Iterable[TextBlock], delimiter: str) -> Iterator[TextBlock]:
    """Blocks of whole rows: where a quoted cell goes on, with the next lines."""
    held = TextBlock(0, b"")
    for block in blocks:
        held = block._replace(line=held.line, content=held.content + block.content) if held.content else block
        if held.content.count(b'"') % 2 and len(held.content) < _MOST_BLOCKS * BLOCK and _open(held, delimiter):
            continue
        yield held
        held = TextBlock(0, b"")
    if held.content:
        yield held


def cut_line(block: TextBlock, delimiter: str, least: int) -> int:
    """Line of a last row without an end that has fewer cells than others, as of a logger that was stopped; 0 without.

    Args:
        block: Whole rows.
        delimiter: As for `rows`.
        least: Number of cells of other rows.
    """
    begin = block.content.rfind(b"\n", 0, -1) + 1
    if block.ended or not block.content[begin:].strip():
        return 0
    line = block.line + block.content.count(b"\n", 0, begin)
    part = block if block.quotes else TextBlock(line, block.content[begin:])
    try:
        last = deque(rows(part, delimiter), 1)
    except OpenQuote as error:
        return line if error.line == line else 0
    except InputError:
        return 0
    return last[0][0] if last and len(last[0][1]) < least else 0


def before(block: TextBlock, line: int) -> TextBlock:
    """The lines of a block before that one."""
    parts = block.content.split(b"\n", line - block.line)
    return TextBlock(block.line, block.content[: len(block.content) - len(parts[-1])])


def _open(block: TextBlock, delimiter: str) -> bool:
    try:
        deque(rows(block, delimiter), 0)
    except OpenQuote:
        return True
    except InputError:
        return False
    return False


def rows(block: TextBlock, delimiter: str) -> Iterator[tuple[int, list[str]]]:
    """Line and cells of each row but empty ones, without blanks around cells.

    Args:
        block: Whole rows.
        delimiter: One character; a blank for any number of blanks and tabs.

    Raises:
        InputError: A quoted cell does not end, is too long, or has text behind it; the message names the line.
    """
    lines: Iterable[str] = StringIO(block.content.decode(), "\n")
    if delimiter == " ":
        lines = (_BLANKS.sub(_one_blank, line).strip(" \n") + "\n" for line in lines)
    reader = csv.reader(lines, delimiter=delimiter, strict=True, skipinitialspace=delimiter != " ")
    while True:
        line = block.line + reader.line_num
        try:
            row = next(reader)
        except StopIteration:
            return
        except csv.Error as error:
            if "end of data" in str(error):
                raise OpenQuote(line) from error
            raise InputError(f"line {line}: {error}.") from error
        if len(row) > 1 or (row and row[0].strip()):
            yield line, [cell.strip() for cell in row]


def _one_blank(found: re.Match[str]) -> str:
    return found[1] or " "
