"""Fits that other processes can use."""

import io
import pickle
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ..model import Fitted


class PortableFit:
    """A fit that can be pickled whatever made it; its programs of JAX are compiled anew in another process.

    Attributes:
        fitted: The fit.
    """

    def __init__(self, fitted: "Fitted") -> None:
        self.fitted = fitted

    def __reduce__(self) -> tuple[Any, ...]:
        import cloudpickle
        import jax

        class Pickler(cloudpickle.Pickler):
            """Guides of NumPyro keep tracers of their first run, of which they read only the shapes."""

            def reducer_override(self, obj: Any) -> Any:
                if isinstance(obj, jax.core.Tracer):  # type: ignore[attr-defined]
                    keys = jax.numpy.issubdtype(obj.dtype, jax.dtypes.prng_key)
                    return _some, (obj.shape, None if keys else obj.dtype)
                return super().reducer_override(obj)

        file = io.BytesIO()
        Pickler(file).dump(self.fitted)
        return _restored, (file.getvalue(),)


def _some(shape: tuple[int, ...], dtype: Any) -> Any:
    """Some array; of keys without a dtype."""
    import jax

    if dtype is not None:
        return jax.numpy.zeros(shape, dtype)
    return jax.random.wrap_key_data(jax.numpy.zeros((*shape, 2), "uint32"))


def _restored(content: bytes) -> PortableFit:
    import jax

    with jax.enable_x64(True):  # otherwise arrays in double precision would lose it
        return PortableFit(pickle.loads(content))  # noqa: S301 - written by `PortableFit.__reduce__`
