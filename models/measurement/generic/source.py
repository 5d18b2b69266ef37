"""Where generative models of users come from: files named on a command line, functions registered, installed packages.

The code of a file runs when a user names it, and never because a saved fit is opened.
"""

import hashlib
import importlib.util
import inspect
import re
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...errors import InputError, check_path
from .contract import StoryFunction

if TYPE_CHECKING:
    from importlib.metadata import EntryPoints

GROUP = "solidtouch.models"
"""Entry points of packages: the name of a model, and its function."""
_FORM = re.compile(r"(?P<file>.+\.py):(?P<function>\w+)")
_registered: dict[str, StoryFunction] = {}


def add(function: Callable[..., Any], name: str) -> StoryFunction:
    """Registers a function under a name.

    Raises:
        InputError: It does not keep the contract.
    """
    _registered[name] = StoryFunction.of(function, name)
    return _registered[name]


def registered_of(kinds: Iterable[str]) -> dict[str, StoryFunction]:
    """Those models of some kinds that are generative models named in this process, for `take_over` in another."""
    return {kind: _registered[kind] for kind in kinds if kind in _registered}


def take_over(registered: dict[str, StoryFunction]) -> None:
    """Registers what another process has registered."""
    _registered.update(registered)


@contextmanager
def undone_on_error() -> Iterator[None]:
    """Takes back what is registered inside the block if that ends with an exception."""
    before = dict(_registered)
    try:
        yield
    except BaseException:
        _registered.clear()
        _registered.update(before)
        raise


def _installed(**chosen: Any) -> "EntryPoints":
    """Generative models of installed packages."""
    from importlib.metadata import entry_points  # takes a tenth of the start of a command

    return entry_points(group=GROUP, **chosen)


def has_name(name: str) -> bool:
    """Whether a name is that of a registered or installed model, or of the form FILE.py:FUNCTION, which is not run."""
    return name in _registered or _FORM.fullmatch(name) is not None or bool(_installed(name=name))


def registered(name: str) -> StoryFunction | None:
    """Generative model of a name that was named before, whose code has therefore run."""
    return _registered.get(name)


def function_of(story: Callable[..., Any] | str) -> StoryFunction:
    """Generative model given by itself or by its place.

    Raises:
        InputError: There is none.
    """
    if callable(story):
        return StoryFunction.of(story, getattr(story, "__name__", "story"))
    found = named(str(story))
    if found is None:
        raise InputError(f"No function {story!r}; expected FILE.py:FUNCTION.")
    return found


def named(name: str) -> StoryFunction | None:
    """Generative model of a name, its file loaded if need be; `None` if the name is of no such form.

    Raises:
        InputError: The file or its function is missing, or the file fails when it is run.
    """
    if name in _registered:
        return _registered[name]
    if matched := _FORM.fullmatch(name):
        return add(_from_file(Path(matched["file"]), matched["function"]), name)
    for entry in _installed(name=name):
        return add(entry.load(), name)
    return None


def known() -> tuple[str, ...]:
    """Names of registered models and of those of installed packages."""
    return tuple(sorted({*_registered, *(entry.name for entry in _installed())}))


def _from_file(path: Path, function: str) -> Any:
    if not check_path(path).is_file():
        raise InputError(f"{path}: no such file.")
    spec: Any = importlib.util.spec_from_file_location(f"{path.stem}_{_digest(path.read_bytes())[:8]}", path)
    module = importlib.util.module_from_spec(spec)
    sys.path.insert(0, str(path.parent))  # what stands beside it, it may import
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:  # whatever a user's file raises
        told = (str(error).splitlines() or [""])[0]
        raise InputError(f"{path}: running it failed: {type(error).__name__}: {told}") from error
    finally:
        sys.path.remove(str(path.parent))
    if not hasattr(module, function):
        functions = (name for name, value in vars(module).items() if inspect.isfunction(value))
        there = sorted(name for name in functions if not name.startswith("_"))
        raise InputError(f"{path}: no function {function!r}; it has {', '.join(there) or 'none'}.")
    return getattr(module, function)


def digest(story: StoryFunction) -> str:
    """Digest of a generative model: of its name, given arguments and file, or of its own code if there is no file."""
    function, given = story.code, []
    if isinstance(story.function, partial):
        import numpy as np

        with np.printoptions(threshold=sys.maxsize, floatmode="unique"):
            given = [repr((story.function.args, story.function.keywords)).encode()]
    source, name = inspect.getsourcefile(function), getattr(function, "__qualname__", "").encode()
    if source is not None and Path(source).is_file():
        return _digest(b"\0".join([name, *given, Path(source).read_bytes()]))
    return _digest(b"\0".join([name, *given, function.__code__.co_code + repr(function.__code__.co_consts).encode()]))


def place(story: StoryFunction) -> str:
    """Where commands find a generative model: FILE.py:FUNCTION or a name of a package; empty if unknown."""
    if _FORM.fullmatch(story.name) or _installed(name=story.name):
        return story.name
    function, name = story.function, getattr(story.code, "__qualname__", "")
    file = inspect.getsourcefile(story.code)
    if isinstance(function, partial) or file is None or not (Path(file).is_file() and name.isidentifier()):
        return ""
    return f"{Path(file).name}:{name}"


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
