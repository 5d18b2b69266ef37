"""Log probability of taps under their own classes, for several forms in turn."""

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ..missing import dependent
from ..states import States
from .any_form import Form
from .bins import TableForm, known_bins
from .forms import BinGaps, GaussianForm, bin_gaps

if TYPE_CHECKING:
    from .moved_taps import MovedTaps

type Own = tuple[NDArray[np.intp], NDArray[np.intp]]
"""Position and object index of each tap, both of shape (N,)."""


class OwnTaps:
    """Taps of known class, prepared for several forms.

    Args:
        taps: Shape (N, J, K).
        own: Their classes.
        edges: Edges of the bins.
        states: Over which probabilities are summed.
    """

    def __init__(self, taps: NDArray[np.floating], own: Own, edges: NDArray[np.float64], states: States) -> None:
        self._states, self._edges = states.apart(), edges
        self._at_rest = bool((self._states.gain == 1).all() and (self._states.offset == 0).all())
        self._where, self._what = own
        self._taps = taps
        self._missing = bool(np.isnan(taps).any())
        self._prepared: MovedTaps | None = None

    @cached_property
    def _gaps(self) -> BinGaps:
        return bin_gaps(self._taps, self._edges, may_miss=True)

    @cached_property
    def _bins(self) -> NDArray[np.intp]:
        return known_bins(self._taps, self._edges, may_miss=True)

    def log_probability(self, form: Form) -> NDArray[np.float64]:
        """Log probability of the bins of each tap under its class, shape (N,).

        Args:
            form: Form of the model in the state of gain 1 and offset 0.
        """
        if isinstance(form, TableForm) and not self._at_rest:
            parts = self._moved(form.shape[1]).log_probability(form.log_prob) + self._states.log_prior[:, None]
        else:
            parts = [
                log_prior + self._plain(in_one_state(form, gain, offset, self._edges), self._where, self._what)
                for gain, offset, log_prior in zip(*(values.tolist() for values in self._states), strict=True)
            ]
        return parts[0] if len(parts) == 1 else np.logaddexp.reduce(parts, axis=0)

    def _moved(self, hypotheses: int) -> "MovedTaps":
        """The taps for tables of so many hypotheses at each position, made once."""
        from .moved_taps import MovedTaps

        if self._prepared is None:
            own = self._where * hypotheses + self._what
            self._prepared = MovedTaps.of(self._bins, own, self._edges, self._states)
        return self._prepared

    def _plain(self, form: Form, where: NDArray[np.intp], what: NDArray[np.intp]) -> NDArray[np.float64]:
        if self._missing and not form.independent:
            raise InputError(dependent("the model"))
        if isinstance(form, TableForm):
            return form.of_bins(self._bins, where, what)
        if not isinstance(form, GaussianForm):
            return form.own(self._taps, self._edges, where, what)
        return form.of_own_gaps(self._gaps, where, what)


def in_one_state(form: Form, gain: float, offset: float, edges: NDArray[np.float64]) -> Form:
    """Form in one state."""
    if gain == 1 and offset == 0:
        return form
    return form.in_state(gain, offset, edges)
