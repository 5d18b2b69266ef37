"""What a command needs as a process of its own: programs compiled by earlier ones, and an end without delay."""

import atexit
import gc
import os
import shutil
import sys
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from hashlib import blake2b
from importlib.machinery import ModuleSpec
from pathlib import Path
from platform import machine, processor
from typing import Any

_KEPT = "JAX_COMPILATION_CACHE_DIR"
_SETTINGS = {"JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0", "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES": "-1"}
_MOST_BYTES = 1 << 28
_PATIENCE_S = 2.0
_SELDOM = 200_000, 50, 1000
_MALLOC = {-1: 1 << 28, -3: 1 << 25}  # M_TRIM_THRESHOLD and M_MMAP_THRESHOLD, the largest that there is, in bytes
_ARENAS = -8  # M_ARENA_MAX


def keep_programs() -> None:
    """Makes JAX keep what it compiles in the user's cache folder; must be called before JAX is imported.

    Does nothing where the environment names a folder. Programs that cannot be read, as after a crash, are removed, all
    of them, and compiled again.
    """
    if _KEPT in os.environ:
        return
    folder = cache_folder()
    os.environ.update(_SETTINGS | {_KEPT: str(folder)})
    show: Any = warnings.showwarning

    def shown(message: Warning | str, *place: Any) -> None:
        if "persistent compilation cache" in str(message):
            shutil.rmtree(folder, ignore_errors=True)
            with suppress(OSError):
                folder.mkdir(parents=True, exist_ok=True)
        else:
            show(message, *place)

    warnings.showwarning = shown


def collect_seldom() -> None:
    """Makes Python search for circular garbage less often."""
    gc.set_threshold(*_SELDOM)


def keep_memory() -> None:
    """Makes the C library of Linux keep memory for the next arrays, which the system would have to clear each time.

    Arrays of 32 MiB or more are given back as before. Threads share as many heaps as there are cores, so that one uses
    what another has freed.
    """
    if sys.platform == "linux" and "numpy" in sys.modules:  # which has loaded ctypes, too
        import ctypes

        from ...models.threads import cores

        library = ctypes.CDLL(None)
        if hasattr(library, "mallopt"):
            for parameter, value in (*_MALLOC.items(), (_ARENAS, cores(None))):
                library.mallopt(parameter, value)


@contextmanager
def kept() -> Iterator[None]:
    """Keeps what is made inside for good, once garbage is collected seldom: searching JAX and others takes long."""
    seldom = gc.isenabled() and gc.get_threshold()[:2] == _SELDOM[:2]  # Python 3.14 has no third generation
    if seldom:
        gc.disable()
    try:
        yield
    finally:
        if seldom:
            gc.freeze()
            gc.enable()


@contextmanager
def without(module: str, user: str) -> Iterator[None]:
    """Hides a module inside, unless it or the one that would load it for nothing is imported already."""
    modules: dict[str, Any] = sys.modules
    hidden = not {module, user} & modules.keys()
    if hidden:
        modules[module] = None  # makes imports of it fail
    try:
        yield
    finally:
        if hidden:
            del modules[module]


@contextmanager
def empty(module: str, user: str) -> Iterator[None]:
    """As `without`, for who looks at all modules of a package: the module, `package.name`, can be imported."""
    modules: dict[str, Any] = sys.modules
    finder: Any = _Empty(module)
    if not {module, user} & modules.keys():
        sys.meta_path.insert(0, finder)
    try:
        yield
    finally:
        if finder in sys.meta_path:
            sys.meta_path.remove(finder)
            if modules.pop(module, None) is not None:
                package, _, name = module.rpartition(".")
                delattr(modules[package], name)


class _Empty:
    def __init__(self, module: str) -> None:
        self._module = module

    def find_spec(self, name: str, *_: Any) -> ModuleSpec | None:
        loader: Any = self
        return ModuleSpec(name, loader) if name == self._module else None

    def create_module(self, _: ModuleSpec) -> None:
        """Python makes one."""

    def exec_module(self, _: Any) -> None:
        """Nothing is in it."""


def switch_often() -> None:
    """Makes threads of Python take turns each millisecond: those back from compiled loops would wait five."""
    sys.setswitchinterval(0.001)


def cache_folder() -> Path:
    """Folder of programs for this processor; machine code for another one could not run here."""
    home = Path.home()
    places = {"darwin": home / "Library/Caches", "win32": Path(os.environ.get("LOCALAPPDATA", home))}
    place = Path(os.environ.get("XDG_CACHE_HOME") or places.get(sys.platform, home / ".cache"))
    able = processor()
    with suppress(OSError), Path("/proc/cpuinfo").open(encoding="utf-8") as lines:
        able = next((line for line in lines if line.startswith(("flags", "Features"))), able)
    return place / "solidtouch" / f"{machine()}-{blake2b(able.encode(), digest_size=8).hexdigest()}"


def _end() -> None:
    """Waits for threads and calls what is to be called at the end, as Python does."""
    python: Any = threading, atexit
    python[0]._shutdown()
    python[1]._run_exitfuncs()


def leave(code: int) -> None:
    """Ends the process as Python would, except that nothing is freed, which takes up to a second after JAX has run.

    After a failure or Ctrl-C, threads that go on working are waited for two seconds at most. Returns if output cannot
    be written, to end in the usual way.
    """
    if code:
        waited: Any = threading  # Python 3.12 would wait in the other thread for this one
        getattr(waited, "_shutdown_locks", set()).discard(getattr(waited.main_thread(), "_tstate_lock", None))
        ending = threading.Thread(target=_end, daemon=True)
        ending.start()
        ending.join(_PATIENCE_S)
    else:
        _end()
    folder = Path(os.environ.get(_KEPT, ""))
    if "jax" in sys.modules and folder == cache_folder():
        with suppress(OSError):
            if sum(entry.stat().st_size for entry in os.scandir(folder)) > _MOST_BYTES:
                shutil.rmtree(folder)
    with suppress(OSError, ValueError):
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
