"""What several folders of tests share: one random generator, recorded data, and small tap sets."""

import gc
import hashlib
import importlib.util
import os
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import settings

if TYPE_CHECKING:  # the process that hands the tests out needs none of them
    import numpy as np
    from numpy.typing import NDArray
    from solidtouch.models.measurement.histogram import HistogramModel
    from solidtouch.models.taps import TapSet

# Collecting the tests makes a million objects that stay; at the default pace, looking for garbage takes a sixth of it.
gc.set_threshold(200_000, 20, 100)

# Otherwise each process would compile all modules and rewrite all assertions anew, two fifths of collecting the tests.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

_KEPT_S, _LEFT_S = 14 * 86400, 86400


def pytest_configure(config: pytest.Config) -> None:
    """Each run draws other examples, so those without the slow tests, which are the most, draw half as many.

    How long an example takes depends on the machine, and on whether it is the first that compiles.
    """
    settings.register_profile(
        "solidtouch", deadline=None, max_examples=50 if config.option.markexpr == "not slow" else 100
    )
    settings.load_profile("solidtouch")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Folders whose files take long come first, so that no process is left alone with one at the end."""
    folders = ["stress", "cli", "analysis", "models", "inference", "benchmarks", "hardware"]
    depth = len(Path(__file__).parent.parts)

    def place(item: pytest.Item) -> int:
        first = item.path.parts[depth]
        return folders.index(first) if first in folders else -1

    items.sort(key=place)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """As `--dist loadfile`, but one process tests the conformance kit, whose exact answers it computes once."""
    from xdist.scheduler import LoadFileScheduling

    class Scheduling(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            kit = "tests/analysis/conformance/"
            return kit if nodeid.startswith(kit) else super()._split_scope(nodeid)

    return Scheduling(config, log) if config.option.dist == "loadfile" else None


@pytest.fixture(scope="session", autouse=True)
def _one_blas_thread() -> Iterator[None]:
    """Linear algebra of the small sizes of tests is several times slower on several threads."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):
        yield


@pytest.fixture(scope="session", autouse=True)
def _links_of_pages_lead_somewhere() -> Iterator[None]:
    """Every page that a test makes in this process is looked at, whatever the test is about."""
    from solidtouch.analysis.page import html

    rendered = html.render_page

    def checked(*args: Any, **options: Any) -> str:
        text = rendered(*args, **options)
        ids = re.findall(r'<[^>]* id="([^"]*)"', text)
        assert len(ids) == len({*ids}), f"Not unique: {ids}"
        assert {*re.findall(r'<a href="#([^"]*)"', text)} <= {*ids}
        return text

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(html, "render_page", checked)
        yield


@pytest.fixture(scope="session", autouse=True)
def _xla_compiles_once() -> Iterator[Callable[[], None]]:
    """Machine code of XLA is kept between runs in `build/xla`, as numba keeps its own beside the source.

    Its key is a hash of the whole program, so changed code is compiled anew. JAX does not write files atomically, so
    each process has a folder of its own. The function that this gives publishes what is new there, and takes over what
    others have published. XLA optimizes little, as most programs of tests run for a shorter time than they compile.
    """
    if "jax" not in sys.modules:
        yield lambda: None
        return
    from llvmlite.binding import get_host_cpu_features

    features = hashlib.sha256(get_host_cpu_features().flatten().encode()).hexdigest()[:12]
    kept = Path(__file__).parents[1] / "build" / "xla" / features
    kept.mkdir(parents=True, exist_ok=True)
    for left in kept.parent.glob("tmp*"):  # by a run that was killed
        with suppress(FileNotFoundError):
            if time.time() - left.stat().st_mtime > _LEFT_S:
                shutil.rmtree(left, ignore_errors=True)
    for entry in kept.iterdir():
        with suppress(FileNotFoundError):  # another run may have removed it
            if time.time() - entry.stat().st_mtime > _KEPT_S:
                entry.unlink()
    with tempfile.TemporaryDirectory(dir=kept.parent) as own:

        def share() -> None:
            for source, target in ((Path(own), kept), (kept, Path(own))):
                # Folders there are XLA's own, of choices among programs of a GPU. Thousands of files are listed for
                # each module, so each is not looked at by itself.
                files = {entry.name for entry in os.scandir(source) if entry.is_file()}
                for name in files - {entry.name for entry in os.scandir(target)}:
                    with suppress(FileNotFoundError, FileExistsError):  # another run was faster
                        (target / name).hardlink_to(source / name)

        share()
        config = sys.modules["jax"].config
        config.update("jax_compilation_cache_dir", own)
        config.update("jax_persistent_cache_min_compile_time_secs", 0)
        config.update("jax_disable_most_optimizations", True)
        config.update("jax_traceback_in_locations_limit", 0)  # where each operation comes from is read by nobody
        yield share
        share()


@pytest.fixture(scope="module", autouse=True)
def _xla_compiles_once_for_all(_xla_compiles_once: Callable[[], None]) -> None:
    """What one process has compiled for its last file the others need not compile for their next."""
    _xla_compiles_once()


@pytest.fixture
def rng() -> "np.random.Generator":
    import numpy as np

    return np.random.default_rng(2013)


@pytest.fixture(scope="session")
def fake_rig() -> ModuleType:
    """The module `tests/fake_rig.py`."""
    spec = importlib.util.spec_from_file_location("fake_rig", Path(__file__).with_name("fake_rig.py"))
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of recorded data beside the repository, or a skip."""
    folder = Path(__file__).parents[1].parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("the folder ../shared/data with recorded taps is not there")
    return folder


@pytest.fixture(scope="session")
def make_taps() -> "Callable[..., TapSet]":
    """A function that makes small random tap sets with pairwise different sizes, classes interleaved."""
    import numpy as np
    from solidtouch.models.preprocessing import Preprocessing
    from solidtouch.models.taps import TapSet

    def make(
        L: int = 3, M: int = 4, J: int = 6, K: int = 5, sessions: int = 2, repeats: int = 7, seed: int = 0, **more
    ) -> "TapSet":
        rng = np.random.default_rng(seed)
        session, _, where, what = (index.reshape(-1) for index in np.indices((sessions, repeats, L, M)))
        taps = rng.normal(size=(len(what), J, K)) + where[:, None, None] + 3 * what[:, None, None]
        arguments = {
            "where": 1.5 * where,
            "where_value": 1.5 * np.arange(L),
            "where_unit": "mm",
            "session": session,
            "trial": np.concatenate([np.arange(L * M * repeats)] * sessions),
            "preprocessing": Preprocessing(samples=J, rate_hz=50.0),
            **more,
        }
        return TapSet.from_arrays(taps, what, [f"rod {2 + 2 * m} mm" for m in range(M)], **arguments)

    return make


@pytest.fixture(scope="session")
def make_model() -> "Callable[..., HistogramModel]":
    """A function that makes small models of random histograms with pairwise different sizes."""
    import numpy as np
    from solidtouch.models.grid import ClassGrid
    from solidtouch.models.measurement.histogram import HistogramModel
    from solidtouch.models.preprocessing import Preprocessing

    def make(
        L: int = 3,
        M: int = 4,
        K: int = 2,
        J: int = 5,
        B: int = 7,
        *,
        seed: int = 0,
        taps: int = 3,
        power: str | float = "J",
        pseudocount: float = 0.01,
        value_range: str = "global",
        untrained: Iterable[tuple[int, int]] = (),
    ) -> "HistogramModel":
        rng = np.random.default_rng(seed)
        counts = rng.multinomial(taps * J, rng.dirichlet(np.full(B, 0.7), size=(L, M, K)))
        for l, m in untrained:
            counts[l, m] = 0
        edges = np.linspace(-1.5, 2.0, B + 1)
        if value_range == "taxel":
            edges = rng.normal(size=(K, 1)) + np.arange(1.0, K + 1)[:, np.newaxis] * edges
        grid = ClassGrid(1.5 * np.arange(L), "mm", None, tuple((f"object {m}",) for m in range(M)))
        return HistogramModel(grid, edges, power, Preprocessing(samples=J), counts, pseudocount)

    return make


@pytest.fixture(scope="session")
def draw_samples() -> "Callable[..., NDArray[np.float64]]":
    """A function that draws taps of random trained classes, or of one, from a model's own histograms."""
    import numpy as np
    from solidtouch.hardware.simulator.model_rig import bin_tables

    def draw(model: "HistogramModel", T: int, seed: int = 0, where: int | None = None, what: int = 0) -> "NDArray":
        rng = np.random.default_rng(seed)
        tables = bin_tables(model.probabilities, model.edges, model.grid.shape)
        classes = np.argwhere(model.trained)
        chosen = classes[rng.integers(len(classes), size=T)] if where is None else [(where, what)] * T
        shape = model.preprocessing.samples, model.counts.shape[2]
        return np.array([tables.values(l, m, rng.random(shape)) for l, m in chosen])

    return draw


@pytest.fixture
def make_study(tmp_path, make_taps) -> Callable[..., Path]:
    """A function that writes a small study of recorded taps, 3 x 4 classes, and returns the file."""

    def make(grid: str = "", trials: int = 30, data: str = "", name: str = "study.toml", head: str = "") -> Path:
        make_taps().save(tmp_path / "taps.nc", force=True)
        path = tmp_path / name
        path.write_text(
            f"""name = "small"\ntrials = {trials}\nthresholds = [0.5, 0.95]\ndeadline = 20\n{head}
[[data]]\nname = "rods"\nfiles = ["taps.nc"]\n{data}\n[grid]\n{grid}\n""",
            encoding="utf-8",
        )
        return path

    return make
