"""One thread for each process: a sweep has as many processes as it may have cores.

Matrix products that are divided among other numbers of threads may round differently, and cells must not depend on
where they run.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager

from ...models.threads import one_blas_thread

_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")


@contextmanager
def one_thread() -> Iterator[None]:
    """Limits linear algebra to one thread, also in libraries loaded and processes started within the block."""
    before = {name: os.environ.get(name) for name in _VARIABLES}
    os.environ.update(dict.fromkeys(_VARIABLES, "1"))
    try:
        with one_blas_thread():
            yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
