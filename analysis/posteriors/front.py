"""Reference posteriors for Python: functions of `solidtouch.conformance`."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from .catalogue import ReferencePosterior, export, posterior
from .comparison import DrawsVerdict, compare_draws
from .files import named_draws, read_draws


def reference_posterior(name: str) -> ReferencePosterior:
    """The reference posterior of a measurement model: data, moments and draws.

    >>> import solidtouch as st
    >>> reference = st.conformance.reference_posterior("gaussian")
    >>> reference.data["taps"].shape
    (48, 2, 2)
    >>> [f"{number.name}: {number.mean:.2f}" for number in reference.numbers[:2]]
    ['level.1.1.1: 0.85', 'level.1.1.2: 1.16']

    Args:
        name: Of the model, such as `"gaussian"`.

    Raises:
        InputError: There is none of this name.
    """
    return posterior(str(name))


def judge_draws(name: str, draws: Mapping[str, Any] | Any | str | Path | Sequence[str | Path]) -> DrawsVerdict:
    """Whether draws of a program are of a reference posterior.

    >>> import solidtouch as st
    >>> reference = st.conformance.reference_posterior("gaussian")
    >>> verdict = st.conformance.judge_draws("gaussian", reference.draws)
    >>> verdict.status
    'pass'
    >>> wrong = reference.draws | {"level.1.1.1": 2 * reference.draws["level.1.1.1"]}
    >>> st.conformance.judge_draws("gaussian", wrong).differences[0].name
    'level.1.1.1'

    Args:
        name: Of the reference posterior.
        draws: Arrays by name, each of shape (chain, draw, ...), as NumPyro's `get_samples(group_by_chain=True)` has
            them; a data set of xarray with these dims; what ArviZ makes of them, with the group `posterior`; or files
            as `solidtouch conformance draws` reads them.

    Raises:
        InputError: There is no such posterior, or the draws cannot be read or judged.
    """
    reference = posterior(str(name))
    if isinstance(draws, str | Path):
        return compare_draws(reference, read_draws([draws]))
    if isinstance(draws, list | tuple) and all(isinstance(path, str | Path) for path in draws):
        return compare_draws(reference, read_draws(draws))
    return compare_draws(reference, named_draws(draws))


def export_posteriors(folder: str | Path, force: bool = False) -> int:
    """Writes all files of the reference posteriors, all or none.

    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> import solidtouch as st
    >>> with TemporaryDirectory() as folder:
    ...     _ = st.conformance.export_posteriors(Path(folder, "reference"))
    ...     sorted(path.name for path in Path(folder, "reference").glob("gaussian*"))
    ['gaussian.csv.gz', 'gaussian.data.json', 'gaussian.json']

    Args:
        folder: Where to.
        force: Whether files in an existing folder may be replaced.

    Returns:
        Their number.

    Raises:
        InputError: The folder cannot be written, or exists and `force` is not set.
    """
    return export(folder, force)
