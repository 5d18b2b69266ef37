"""Guesses which parts of the names of files or arrays are labels."""

import re
from collections.abc import Mapping, Sequence, Set
from typing import NamedTuple

from ..patterns import compiled_pattern, natural, number_in
from .guess import Guess, like, shown

_BETWEEN = (
    re.compile(r"((?:[/_\s-]|(?<!\d)\.|\.(?!\d))+)"),
    re.compile(r"((?:[/_\s]|-(?!\d)|(?<!\d)\.|\.(?!\d))+)"),
    re.compile(r"(/|\.(?=[^/.]*$))"),
)
"""Between words, of which none is a point within a number; with minus as a sign; between whole names."""
_MONTH, _DAY = r"(?:0[1-9]|1[0-2])", r"(?:0[1-9]|[12]\d|3[01])"
_DATE = re.compile(
    rf"(?<!\d)(?:(?:19|20)\d\d([-_.]?){_MONTH}\1{_DAY}|{_DAY}([-_.]){_MONTH}\2(?:19|20)\d\d)(?!\d)", re.ASCII
)
_CLOCK = re.compile(r"(?:[01]\d|2[0-3])[0-5]\d[0-5]\d", re.ASCII)
_HIDDEN = str.maketrans("-_.", "\ue000\ue001\ue002")
"""Stands for what divides a date, which is one word."""
_SEEN = str.maketrans("\ue000\ue001\ue002", "-_.")
_TAXEL = re.compile(r"taxels?|channels?|ch|kanal|sensors?|fingers?|(?:finger)?tips?|electrodes?|fsr", re.IGNORECASE)
_FINGERS = {"thumb", "index", "middle", "ring", "little", "pinky", "palm"}
_SPLITS = {"train", "training", "test", "testing", "val", "valid", "validation", "dev", "eval"}
_LETTERS = re.compile(r"[^\W\d_]*")
_LENGTHS = {"mm", "cm", "deg", "grad", "um", "µm", "m"}
_SESSIONS = 8
"""Files of which each has a number of its own are taps rather than sessions if they are more."""
_WITH_ENDING = 3
"""Parts of a name of one word, with what is between."""
_WORD = 3
"""Letters of a word that is no abbreviation, such as that of a position."""
NOT_USED = "not used"
"""Key of what no line of a map takes."""


class _Word(NamedTuple):
    """A part of names that differs between them.

    Attributes:
        values: In each name.
        before: The word before it, if that is the same in all names.
        after_date: Whether a date is before it.
        complete: Whether each value is beside all the same other parts.
        last: Whether no other part that differs comes after it, but that of taxels.
    """

    values: tuple[str, ...]
    before: str
    after_date: bool
    complete: bool
    last: bool = False

    @property
    def letters(self) -> str:
        """Letters that all values begin with, and go on with a number."""
        letters = {_LETTERS.match(value)[0] for value in self.values}  # pyright: ignore - it always matches
        return letters.pop() if len(letters) == 1 else ""

    @property
    def called(self) -> str:
        """What it is called in the names."""
        return self.letters or self.before

    @property
    def of_size(self) -> bool:
        """Whether a number goes with the name of an object, as in `rod4mm`."""
        is_label = any(like(key, self.letters) for key in ("where", "session", "trial"))
        return len(self.letters) >= _WORD and not is_label and not self.tells_taxel

    @property
    def numbers(self) -> bool:
        """Whether each value has one number."""
        return all(number_in(value) is not None for value in set(self.values))

    @property
    def tells_taxel(self) -> bool:
        """Whether values are those of fingers, channels or taxels, each beside all the same others."""
        named = self.numbers and _TAXEL.fullmatch(self.called) is not None
        return self.complete and (named or {value.lower() for value in self.values} <= _FINGERS)

    @property
    def dates(self) -> bool:
        """Whether each value is a date."""
        return all(map(_DATE.fullmatch, self.values))


def name_pattern(names: Sequence[str], of_taps: bool = True, taken: Set[str] = frozenset()) -> tuple[str, list[Guess]]:
    """Pattern of the names of files or arrays, and what its fields may be; empty where all names are one.

    Names are divided into words and numbers. Where all have equally many and the same letters between them, words that
    differ become fields: sessions by their name or as dates, numbers with a unit positions, those after x and y places
    in a plane, numbers of fingers or channels taxels, other numbers trials, other words objects.

    Args:
        names: The names.
        of_taps: Whether each may be one tap, so that further numbers are trials rather than sessions.
        taken: Labels that the names do not tell, as columns do.
    """
    if len(names) < 2:
        return "", []
    for between in _BETWEEN:
        if parts := _divided(names, between):
            columns = [tuple(each[i] for each in parts) for i in range(len(parts[0]))]
            for with_dates in (True, False):
                pattern, fields, told = _pattern(columns, with_dates, of_taps, between is _BETWEEN[-1], taken)
                if fields and _reads(pattern, names, told):
                    return pattern, fields
    return "", []


def _pattern(
    columns: Sequence[tuple[str, ...]], with_dates: bool, of_taps: bool, whole: bool, told: Set[str]
) -> tuple[str, list[Guess], dict[str, tuple[str, ...]]]:
    """Pattern of names that are divided, its fields, and the text of each field in each name."""
    words = _words(columns)
    found = _plane(words)
    for strict in (True, False):
        for word in words.values():
            left_out = (whole and _tells_nothing(word)) or (word.dates and not with_dates) or _counts(word, words)
            if word.values not in found and not left_out:
                taken = {guess.key for guess in found.values()} | told
                key, reason = _field(word, taken, told, strict=strict, of_taps=of_taps)
                if key:
                    found[word.values] = Guess(key, f"{{{key}}}", reason, of_names=True)
    pieces = [
        _piece(words[i], found.get(column)) if i in words else re.sub(r"[{}*?]", "?", column[0])
        for i, column in enumerate(columns)
    ]
    _doubt_sizes(found)
    fields = [_by_date(guess, values) for values, guess in found.items()]
    unused = [word.values for word in words.values() if fields and word.values not in found]
    fields += [Guess(NOT_USED, shown(_distinct(values)), "which no field takes", of_names=True) for values in unused]
    return "".join(pieces), fields, {guess.value[1:-1]: values for values, guess in found.items()}


def _reads(pattern: str, names: Sequence[str], told: Mapping[str, Sequence[str]]) -> bool:
    """Whether a pattern divides names as meant; letters before a number may be outside of its field."""
    compiled = compiled_pattern(pattern, "names")
    for i, name in enumerate(names):
        found = compiled.fullmatch(name)
        if found is None or any(not told[key][i].endswith(text) for key, text in found.groupdict().items()):
            return False
    return True


def _divided(names: Sequence[str], between: re.Pattern[str]) -> list[list[str]]:
    """Words of each name, and what is between them; empty where names have not equally many, or other signs between."""
    hidden = (_DATE.sub(lambda date: date[0].translate(_HIDDEN), name) for name in names)
    parts = [[part.translate(_SEEN) for part in between.split(name)] for name in hidden]
    fewest = min(map(len, parts))
    if fewest > _WITH_ENDING:
        parts = [_first_joined(each, len(each) - fewest) for each in parts]
    alike = len({len(each) for each in parts}) == 1
    return parts if alike and len({tuple(each[1::2]) for each in parts}) == 1 else []


def _first_joined(parts: list[str], more: int) -> list[str]:
    """Parts of a path of which the first one of the file's name has so many more, as a name of several words has."""
    at = max((i + 1 for i, part in enumerate(parts) if i % 2 and "/" in part), default=0)
    return [*parts[:at], "".join(parts[at : at + more + 1]), *parts[at + more + 1 :]]


def _words(columns: Sequence[tuple[str, ...]]) -> dict[int, _Word]:
    """Parts that differ between names, by their number."""
    varying = [i for i, column in enumerate(columns) if len(set(column)) > 1]
    words = {
        i: _Word(
            values=columns[i],
            before=columns[i - 2][0] if i > 1 and i - 2 not in varying else "",
            after_date=i > 1 and all(map(_DATE.fullmatch, columns[i - 2])),
            complete=_complete(columns[i], [columns[j] for j in varying if j != i]),
        )
        for i in varying
    }
    last = max((i for i, word in words.items() if not word.tells_taxel), default=-1)
    return {i: word._replace(last=i == last) for i, word in words.items()}


def _tells_nothing(word: _Word) -> bool:
    """Whether these are whole names of which hardly any occurs twice."""
    return not word.numbers and len(set(word.values)) > len(word.values) // 2


def _doubt_sizes(found: dict[tuple[str, ...], Guess]) -> None:
    """Adds to the reason of positions that they may be sizes, if some objects have only some of them."""
    by_key = {guess.key: values for values, guess in found.items()}
    if not {"what", "where"} <= by_key.keys() or "check" not in found[by_key["where"]].reason:
        return
    objects, places = by_key["what"], by_key["where"]
    if len(set(zip(objects, places, strict=True))) < len(set(objects)) * len(set(places)):
        reason = f"{found[places].reason}, or sizes of objects: not all objects have all of them"
        found[places] = found[places]._replace(reason=reason)


def _counts(word: _Word, words: Mapping[int, _Word]) -> bool:
    """Whether numbers only count the texts of another part, as in `01_cork` and `02_felt`."""
    if not word.numbers or word.letters or word.dates:
        return False
    if len(set(word.values)) == len(word.values):
        return False
    texts = [set(zip(word.values, other.values, strict=True)) for other in words.values() if not other.numbers]
    return any(len(set(word.values)) == len(pairs) == len({text for _, text in pairs}) for pairs in texts)


def _distinct(values: Sequence[str]) -> list[str]:
    return sorted(set(values), key=natural)


def _piece(word: _Word, guess: Guess | None) -> str:
    """A part of the pattern."""
    if guess is None:
        of_one_length = word.numbers and len({len(value) for value in word.values}) == 1
        return re.sub(r"\w" if of_one_length else r"\d", "?", word.values[0]) if word.dates or of_one_length else "*"
    letters = word.letters if word.numbers and guess.key not in ("what", "session") else ""
    return f"{letters}{guess.value}"


def _by_date(guess: Guess, values: Sequence[str]) -> Guess:
    """Sessions by the dates in names."""
    if guess.key != "session" or not all(map(_DATE.fullmatch, values)):
        return guess
    return Guess("session", "date:{session}", f"dates in names, {guess.reason}")


def _plane(words: dict[int, _Word]) -> dict[tuple[str, ...], Guess]:
    """Two parts that are x and y."""
    called = {word.called.lower(): word.values for word in words.values() if word.numbers}
    if not {"x", "y"} <= called.keys():
        return {}
    return {called[axis]: Guess(axis, f"{{{axis}}}", f"numbers after {axis}", of_names=True) for axis in ("x", "y")}


def _field(word: _Word, taken: set[str], told: Set[str], *, strict: bool, of_taps: bool) -> tuple[str, str]:
    """Which field words of names may be, and why; empty if none is left.

    What letters, units and dates tell comes first (`strict`); other numbers are the trial if they are the last ones,
    else the position or the session.
    """
    reason = shown(_distinct(word.values))
    wanted = _told(word)
    if {value.lower() for value in word.values} <= _SPLITS:
        reason += ", which are numbered in this order"
    if not strict and word.numbers:
        others = ["trial", "where", "session"] if word.last else ["where", "session", "trial"]
        wanted += others if of_taps else ["session", "trial"]
    if not strict:
        wanted.append("session" if "what" in told else "what")
    taken = taken | ({"where"} if "x" in taken else set())
    key = next((key for key in wanted if key not in taken), "")
    short = all(len(value) == 1 for value in word.values)
    if key == "what" and short:
        reason += "; check whether these are objects"
    if key == "session" and key not in _told(word):
        reason += "; check whether these are sessions"
    if key == "where" and (key not in _told(word) or not word.called):
        reason += "; check whether these are positions"
    return (key, f"numbers {reason}" if key in ("where", "trial") else reason) if key else ("", "")


def _told(word: _Word) -> list[str]:
    """Fields that words may be by their letters, units and dates."""
    values, called = set(word.values), word.called
    if word.dates or any(map(_DATE.search, values)):
        return ["session"]
    if word.tells_taxel:
        return ["taxel"]
    hint = f"{word.before} {re.sub(r'\d+', ' ', ' '.join(sorted(values)[:20]))}"
    if not word.numbers:
        is_session = like("session", hint) or {value.lower() for value in values} <= _SPLITS
        return ["session" if is_session else "what"]
    units = {number[1] for value in values if (number := number_in(value)) is not None}
    first = {re.sub(r"[\d.,+-]", " ", value).split(" ")[0] for value in values}
    letters = {each.lower() for each in first}
    found: list[str] = []
    if like("what", called) or called.lower() == "obj":
        found.append("what")
    several = len(values) > _SESSIONS and len(values) == len(word.values)
    if (like("session", hint) and not several) or letters in ({"s"}, {"d"}) or first == {"P"}:
        found.append("session")
    if several and like("session", hint):
        found.append("trial")
    clock = word.after_date and all(map(_CLOCK.fullmatch, values))
    if clock or like("trial", called) or like("tap", called) or (letters <= {"t", "r", "n"} and "" not in letters):
        found.append("trial")
    decimals = any("." in value or "," in value for value in values)
    measured = bool(units & _LENGTHS) or decimals
    if measured or letters == {"p"} or like("where", called):
        found.append("what" if measured and word.of_size else "where")
    return found


def _complete(values: Sequence[str], others: Sequence[Sequence[str]]) -> bool:
    groups: dict[tuple[str, ...], set[str]] = {}
    for value, *rest in zip(values, *others, strict=True):
        groups.setdefault(tuple(rest), set()).add(value)
    return all(group == set(values) for group in groups.values())
