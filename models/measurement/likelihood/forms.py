"""The two forms of the likelihood of a tap's bins: tables, which stand in `bins`, and Gaussians.

Whatever a model assumes, a tap is judged by the probability of the bins into which its samples fall, so that discrete
and continuous models are on one measure. In a `TableForm` the samples are exchangeable and independent. In a
`GaussianForm` each sample is normal given those before it, in the order of time and, within one time, of the taxels;
its bin has the probability of that normal over the bin, and the logs add up along the tap.

The axis H holds hypotheses, the objects or objects in states, see `states`.
"""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ...threads import cores, in_order
from .bins import TableForm, known_bins

_WIDE = 128  # taxels from which on products of matrices take less time than loops
AT_ONCE = 64  # taps of a Gaussian form that one thread takes at a time
_ROOM = 1 << 22  # bins and log probabilities of independent samples held at a time
_FEW = 1 << 13  # samples whose log probabilities under one class take no longer than to start a thread

type BinGaps = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]


class GaussianForm(NamedTuple):
    """Mixture of Q Gaussians over all samples of a tap, with Cholesky factors in time and across taxels.

    With the residuals r of a tap (J, K), time V_k and taxel W, the innovations are
    u_jk = sum_{k' <= k} W_kk' sum_{i <= j} V_k'ji r_ik', independent and normal with standard deviation `scale`.

    Attributes:
        mean: Mean of the samples, shape (Q, L, H, J, K).
        scale: Standard deviation of each sample given those before it, shape (Q, L, H, J, K).
        time: V, unit lower triangular, shape (G, J, J) with G = 1 for all taxels or G = K for each.
        taxel: W, unit lower triangular, shape (L, H, K, K), or (1, 1, 0, 0) for independent taxels.
        log_weight: Log weights of the mixture, shape (Q,).
    """

    mean: NDArray[np.float64]
    scale: NDArray[np.float64]
    time: NDArray[np.float64]
    taxel: NDArray[np.float64]
    log_weight: NDArray[np.float64]

    @property
    def shape(self) -> tuple[int, int]:
        """(L, H)."""
        return self.mean.shape[1], self.mean.shape[2]

    exchangeable = False
    """Whether a tap may have any number of samples."""

    @property
    def independent(self) -> bool:
        """Whether samples are independent under a hypothesis of each Gaussian."""
        return _independent(self.time, self.taxel)

    def in_state(self, gain: float, offset: float, edges: NDArray[np.float64]) -> Self:  # noqa: ARG002 - as TableForm
        """Form of `gain` times a tap plus `offset`."""
        return self._replace(mean=gain * self.mean + offset, scale=gain * self.scale)

    @staticmethod
    def joined(parts: Sequence["GaussianForm"]) -> "GaussianForm":
        """Form over the hypotheses of several forms, one after another; in time they are alike."""
        first = parts[0]
        shared = first.taxel.shape[:2] == (1, 1)
        return first._replace(
            mean=np.concatenate([part.mean for part in parts], axis=2),
            scale=np.concatenate([part.scale for part in parts], axis=2),
            taxel=first.taxel if shared else np.concatenate([part.taxel for part in parts], axis=1),
        )

    def whitened_mean(self) -> NDArray[np.float64]:
        """The means times V, shape (Q, L, H, J, K)."""
        if _is_one(self.time):
            return self.mean
        if len(self.time) == 1:
            return np.einsum("ji,...ik->...jk", self.time[0], self.mean)
        return np.einsum("kji,...ik->...jk", self.time, self.mean)

    def prepare(self, impossible: NDArray[np.bool_]) -> "PreparedGaussian":
        """Precomputed form; hypotheses in the mask `impossible`, shape (L, H), have likelihood 0."""
        mean = self.whitened_mean()
        Q, L, H, J, K = mean.shape
        return PreparedGaussian(
            mean=np.ascontiguousarray(mean.reshape(Q, L * H, J, K).mT),
            taxel=np.ascontiguousarray(np.concatenate(self.taxel)),
            per_scale=np.ascontiguousarray(1 / self.scale.reshape(Q, L * H, J, K).mT),
            time=np.ascontiguousarray(self.time),
            log_weight=self.log_weight,
            impossible=impossible,
        )

    def own(
        self, taps: NDArray[np.floating], edges: NDArray[np.float64], where: NDArray[np.intp], what: NDArray[np.intp]
    ) -> NDArray[np.float64]:
        """Log probability of the bins of taps (N, J, K) under their own hypotheses, shape (N,)."""
        return self.of_own_gaps(bin_gaps(taps, edges, self.independent), where, what)

    def of_own_gaps(self, gaps: BinGaps, where: NDArray[np.intp], what: NDArray[np.intp]) -> NDArray[np.float64]:
        """As `own`, from the samples with their distances to the edges, see `bin_gaps`."""
        from .innovations import true_class_log_probability

        Q, L, H, J, K = self.mean.shape
        mean, scale = (np.ascontiguousarray(each.reshape(Q, L * H, J, K)) for each in (self.mean, self.scale))
        taxel, time, out = np.concatenate(self.taxel), np.ascontiguousarray(self.time), np.empty(len(where))
        true_class_log_probability(*gaps, where * H + what, mean, taxel, scale, time, self.log_weight, out)
        return out

    def innovations(
        self, taps: NDArray[np.floating], where: NDArray[np.intp], what: NDArray[np.intp], q: int = 0
    ) -> NDArray[np.float64]:
        """Prediction errors of the samples of taps (N, J, K) under hypotheses (N,), shape (N, J, K)."""
        white = taps - self.mean[q, where, what]
        if not _is_one(self.time):
            time = np.broadcast_to(self.time, (white.shape[2], *self.time.shape[1:]))
            white = np.einsum("kji,nik->njk", time, white, optimize=True)
        if not self.taxel.shape[-1]:
            return white
        taxel = np.broadcast_to(self.taxel, (*self.shape, *self.taxel.shape[2:]))[where, what]
        return white @ taxel.swapaxes(-1, -2)

    def sample(
        self,
        where: NDArray[np.intp],
        what: NDArray[np.intp],
        edges: NDArray[np.float64],  # noqa: ARG002 - as TableForm
        J: int,  # noqa: ARG002 - as TableForm
        generator: np.random.Generator,
    ) -> NDArray[np.float64]:
        """Taps under hypotheses (N,), shape (N, J, K)."""
        q = generator.choice(len(self.log_weight), size=len(where), p=np.exp(self.log_weight))
        white = generator.standard_normal((len(where), *self.mean.shape[-2:]))
        white *= self.scale[q, where, what]
        if self.taxel.shape[-1]:
            taxel = np.broadcast_to(self.taxel, (*self.shape, *self.taxel.shape[2:]))[where, what]
            white = np.linalg.solve(taxel, white.mT).mT
        if not _is_one(self.time):
            time = np.broadcast_to(np.linalg.inv(self.time), (white.shape[2], *self.time.shape[1:]))
            white = np.einsum("kji,nik->njk", time, white, optimize=True)
        white += self.mean[q, where, what]
        return white


class PreparedGaussian(NamedTuple):
    """Precomputed `GaussianForm`, with C = L H.

    Attributes:
        mean: Whitened in time, shape (Q, C, K, J).
        taxel: W, shape (C, K, K), or (1, 0, 0) for independent taxels.
        per_scale: One over the standard deviations, shape (Q, C, K, J).
        time: V, shape (G, J, J).
        log_weight: Shape (Q,).
        impossible: Hypotheses with likelihood 0, shape (L, H).
    """

    mean: NDArray[np.float64]
    taxel: NDArray[np.float64]
    per_scale: NDArray[np.float64]
    time: NDArray[np.float64]
    log_weight: NDArray[np.float64]
    impossible: NDArray[np.bool_]

    @property
    def independent(self) -> bool:
        """Whether samples are independent under a hypothesis of each Gaussian."""
        return _independent(self.time, self.taxel)

    def log_likelihood(
        self, taps: NDArray[np.floating], edges: NDArray[np.float64], exponent: float, out: NDArray[np.float64]
    ) -> None:
        """As `PreparedTable.log_likelihood`; uses tables for independent samples if taps outnumber bins."""
        (J, K), (L, H), B = taps.shape[1:], self.impossible.shape, edges.shape[-1] - 1
        blocks = range(0, len(taps), max(1, _ROOM // (J * K + L * H)))
        if len(taps) > B * len(blocks) and self.independent:
            parts = (self._looked_up(taps[start : start + blocks.step], edges) for start in blocks)
        else:
            blocks = range(0, len(taps), AT_ONCE)
            gaps = (bin_gaps(taps[start : start + AT_ONCE], edges, self.independent) for start in blocks)
            tasks = (partial(self.of_gaps, some) for some in gaps)
            parts = in_order(tasks, cores(None) if len(taps) > AT_ONCE else 1)
        for start, part in zip(blocks, parts, strict=True):
            out[start : start + len(part)] = exponent * part

    def _looked_up(self, taps: NDArray[np.floating], edges: NDArray[np.float64]) -> NDArray[np.float64]:
        """As `of_gaps` for independent samples, with the log probabilities of all bins computed once."""
        from .innovations import independent_log_probability

        bins = known_bins(taps, edges, may_miss=True).transpose(1, 2, 0)
        lower, upper = _open_edges(edges, taps.shape[-1])
        if (bins < 0).any():  # a further bin, of all values
            bins = np.where(bins < 0, lower.shape[1], bins)
            lower, upper = (
                np.pad(part, ((0, 0), (0, 1)), constant_values=end) for part, end in ((lower, -np.inf), (upper, np.inf))
            )
        part = np.empty((self.mean.shape[1], len(taps)))
        given = bins.astype(np.uint32, order="C"), lower, upper, self.mean, self.per_scale, self.log_weight, part
        tasks = (partial(independent_log_probability, c, *given) for c in range(len(part)))
        list(in_order(tasks, cores(None) if taps.size > _FEW else 1))
        return np.where(self.impossible, -np.inf, part.T.reshape(-1, *self.impossible.shape))

    def of_gaps(self, gaps: BinGaps) -> NDArray[np.float64]:
        """Log probability of the bins of taps, see `bin_gaps`, shape (n, L, H)."""
        from .innovations import class_log_probability

        part = np.empty((len(gaps[0]), self.mean.shape[1]))
        if gaps[0].shape[1] == 1 and self.taxel.shape[-1] >= _WIDE:
            self._of_vectors(gaps, part)
        else:
            class_log_probability(*gaps, *self[:-1], part)
        return np.where(self.impossible, -np.inf, part.reshape(-1, *self.impossible.shape))

    def _of_vectors(self, gaps: BinGaps, out: NDArray[np.float64]) -> None:
        """Log probability of the bins of taps of one sample of many taxels, by products of matrices; into (n, C)."""
        from .innovations import vectors_log_probability

        samples, below, above = (part[:, 0] for part in gaps)
        parts = np.empty((len(self.log_weight), len(samples)))
        for c in range(out.shape[1]):
            taxel = self.taxel[c if len(self.taxel) > 1 else 0]
            for q, log_weight in enumerate(self.log_weight):
                innovation = (samples - self.mean[q, c, :, 0]) @ taxel.T
                vectors_log_probability(innovation, below, above, self.per_scale[q, c, :, 0], parts[q])
                parts[q] += log_weight
            out[:, c] = np.logaddexp.reduce(parts, axis=0)


type Form = TableForm | GaussianForm


def bin_gaps(taps: NDArray[np.floating], edges: NDArray[np.float64], may_miss: bool = False) -> BinGaps:
    """Samples in double precision, and distances to the edges of their bins; end bins extend to infinity.

    Args:
        taps: Shape (..., J, K).
        edges: Shape (B + 1,) or (K, B + 1).
        may_miss: Whether samples may be NaN; their bin then holds all values.

    Returns:
        Three arrays of the shape of `taps`: samples, lower and upper gaps.

    Raises:
        InputError: A sample is infinite or, unless it may be missing, NaN.
    """
    bins = known_bins(taps, edges, may_miss)
    K = taps.shape[-1]
    lower, upper = _open_edges(edges, K)
    samples, taxel = np.ascontiguousarray(taps, dtype=np.float64), np.arange(K)
    if (missing := bins < 0).any():
        samples = np.where(missing, 0.0, samples)
        below, above = lower[taxel, bins] - samples, upper[taxel, bins] - samples
        return samples, np.where(missing, -np.inf, below), np.where(missing, np.inf, above)
    return samples, lower[taxel, bins] - samples, upper[taxel, bins] - samples


def _independent(time: NDArray[np.float64], taxel: NDArray[np.float64]) -> bool:
    return not taxel.shape[-1] and _is_one(time)


def _is_one(time: NDArray[np.float64]) -> bool:
    """Whether V does nothing, so that it need not be multiplied by."""
    return bool((time == np.eye(time.shape[-1])).all())


def _open_edges(edges: NDArray[np.float64], K: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lower and upper bin edges of each taxel, both of shape (K, B); end bins extend to infinity."""
    edges = np.broadcast_to(edges, (K, edges.shape[-1]))
    lower, upper = edges[:, :-1].copy(), edges[:, 1:].copy()
    lower[:, 0], upper[:, -1] = -np.inf, np.inf
    return lower, upper
