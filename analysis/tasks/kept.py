"""Values that tasks in one process share."""

from collections import OrderedDict
from collections.abc import Callable, Hashable
from concurrent.futures import Future
from threading import Lock
from typing import Any


class Kept[V]:
    """Values by key, each made when it is first asked for; a copy in another process begins empty.

    Threads that ask for the same value at a time wait for one of them to make it.

    Args:
        most: How many are kept, the last ones used; `None` for all.
    """

    def __init__(self, most: int | None = None) -> None:
        self._most = most
        self._values: OrderedDict[Hashable, Future[V]] = OrderedDict()
        self._lock = Lock()

    def __call__(self, key: Hashable, make: Callable[[], V]) -> V:
        """The value of a key, which may have to be made."""
        with self._lock:
            new = key not in self._values
            value = self._values.setdefault(key, Future())
            self._values.move_to_end(key)
            while self._most is not None and len(self._values) > self._most:
                self._values.popitem(last=False)
        if new:
            try:
                value.set_result(make())
            except BaseException as error:
                value.set_exception(error)
                raise
        return value.result()

    def __reduce__(self) -> tuple[Any, ...]:
        return Kept, (self._most,)
