"""Measurement models as a scikit-learn classifier; scikit-learn is an optional dependency."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Self, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..models.errors import InputError
from ..models.extras import missing
from ..models.measurement.generic.source import undone_on_error
from ..models.measurement.histogram import HistogramModel
from ..models.measurement.model import TapModel
from ..models.measurement.registry import AnyModel, model_name
from ..models.preprocessing import Preprocessing
from ..models.settings import FitSettings
from ..models.taps import TapSet
from .filter import log_fold
from .fit import check_used
from .reference import ZeroEvidenceError
from .tuning.tempering import fit_tempered


class _Absent:
    """Base class without scikit-learn: the classifier can be imported and inspected, but not created."""

    def __new__(cls, *_: Any, **__: Any) -> Self:
        raise ImportError(missing("sklearn"))


try:
    from sklearn.base import BaseEstimator, ClassifierMixin
    from sklearn.utils.metaestimators import available_if
    from sklearn.utils.multiclass import check_classification_targets
    from sklearn.utils.validation import check_is_fitted, validate_data
except ImportError:
    BaseEstimator, ClassifierMixin = _Absent, type("ClassifierMixin", (), {})
    check_classification_targets = check_is_fitted = validate_data = cast("Any", None)

    def available_if(check: Any) -> Any:  # noqa: ARG001 - as that of scikit-learn
        """No condition, as there are no estimators."""
        return lambda method: method


def _takes_parts(classifier: "TapClassifier") -> bool:
    """Whether the model of all taps is a sum over parts.

    Raises:
        InputError: It is not.
    """
    if classifier.model != "histogram" or classifier.edges is None or str(classifier.power).startswith("learned"):
        raise InputError("partial_fit requires model='histogram' with given edges and a power that is not learned.")
    return True


class TapClassifier(ClassifierMixin, BaseEstimator):  # pyright: ignore[reportGeneralTypeIssues]
    """Classifier of single taps with the conventions of scikit-learn, which it requires (`solidtouch[sklearn]`).

    `X` has shape (N, J, K): taps, samples, taxels. `y` has one label per tap, its object. Positions are not modelled:
    all taps of a label train the same distribution. To tell positions apart, put them into the labels, or use `fit`.
    The prior is uniform over the labels, regardless of their numbers of taps.

    >>> import numpy as np
    >>> from sklearn.model_selection import GroupKFold, cross_val_score
    >>> taps = np.random.default_rng(0).normal(size=(60, 10, 3))
    >>> taps[::2] += 2.0
    >>> labels, sessions = np.array(["soft", "hard"] * 30), np.repeat([0, 1, 2], 20)
    >>> cross_val_score(TapClassifier(bins=20), taps, labels, groups=sessions, cv=GroupKFold(3)).tolist()
    [1.0, 1.0, 1.0]

    Args:
        model: Name of the measurement model, see docs/reference/models.md; `smooth` is refused, as it needs positions.
        bins: Number of histogram bins.
        pseudocount: Counts added to every bin of the histogram.
        power: Exponent of the likelihood of a tap.
        value_range: Whether bins span the range of all taxels together or of each.
        edges: Bin edges, shape (B + 1,) or (K, B + 1), instead of those of the training taps; they replace `bins`.
        method: `"closed"`, `"nuts"`, or for functions `"svi"`, `"map"` or `"laplace"`.
        steps: Maximum number of steps of such a fit.
        device: Where JAX computes fits of functions and chains: `"cpu"` or `"gpu"`.
        integrate: Number of draws from the posterior over which decisions are integrated.
        unconverged: Whether a fit that did not converge may be used.
        gain_sd: Session models: standard deviation of the log gain between sessions.
        offset_sd: Session models: standard deviation of the offset between sessions.
        seed: Random seed of fits that draw random numbers.

    Attributes:
        model_: The fitted `TapModel`, of one position.
        classes_: The labels in increasing order, shape (M,).
        n_features_in_: `X.shape[1]`, the number J of samples.
    """

    def __init__(
        self,
        model: AnyModel = "histogram",
        *,
        bins: int = 100,
        pseudocount: float = 0.01,
        power: str | float = "J",
        value_range: str = "global",
        edges: ArrayLike | None = None,
        method: str = "closed",
        steps: int | None = None,
        device: str = "cpu",
        integrate: int = 0,
        unconverged: bool = False,
        gain_sd: float | None = None,
        offset_sd: float | None = None,
        seed: int = 0,
    ) -> None:
        self.model = model
        self.bins = bins
        self.pseudocount = pseudocount
        self.power = power
        self.value_range = value_range
        self.edges = edges
        self.method = method
        self.steps = steps
        self.device = device
        self.integrate = integrate
        self.unconverged = unconverged
        self.gain_sd = gain_sd
        self.offset_sd = offset_sd
        self.seed = seed

    def fit(self, X: ArrayLike, y: ArrayLike, *, session: ArrayLike | None = None) -> Self:
        """Fits the model to training taps.

        Args:
            X: Samples, shape (N, J, K).
            y: Label of each tap, shape (N,).
            session: Recording session of each tap, shape (N,); session models and `power="learned"` use it.

        Raises:
            InputError: As `solidtouch.fit`.
            NotConvergedError: The fit did not converge, and `unconverged` was not set.
        """
        taps, labels = self._labelled(X, y, reset=True)
        classes, what = np.unique(labels, return_inverse=True)
        self.model_: TapModel = self._fitted(taps, what, classes, session)
        self.classes_ = classes
        return self

    @available_if(_takes_parts)
    def partial_fit(self, X: ArrayLike, y: ArrayLike, classes: ArrayLike | None = None) -> Self:
        """Adds training taps; the model equals that of `fit` on all taps given so far.

        Only a histogram with given `edges` and a power that is not learned has this method, as other models depend on
        all taps at once; without it an `AttributeError` is raised.

        Args:
            X: Samples, shape (N, J, K).
            y: Label of each tap, shape (N,).
            classes: All labels that will ever be given; needed in the first call.

        Raises:
            InputError: The edges have changed; or there are no classes in the first call, or other ones.
        """
        known = getattr(self, "classes_", None)
        if known is None and classes is None:
            raise InputError("The first call of partial_fit requires classes.")
        wanted = known if classes is None else np.unique(np.asarray(classes))
        if wanted is None or (known is not None and not np.array_equal(known, wanted)):
            raise InputError(f"The classes must stay those of the first call, {known}, got {classes}.")
        taps, labels = self._labelled(X, y, reset=known is None)
        if unknown := sorted(set(labels.tolist()) - set(wanted.tolist())):
            raise InputError(f"The label {unknown[0]!r} is not among the classes.")
        added: Any = self._fitted(taps, np.searchsorted(wanted, labels), wanted, None)
        if known is not None:
            added = _joined(self.model_, added)
        self.model_, self.classes_ = added, wanted
        return self

    def predict_log_proba(self, X: ArrayLike) -> NDArray[np.float64]:
        """Log posterior probability of each label after one tap, shape (N, M), labels as in `classes_`.

        Raises:
            InputError: The taps differ in shape from the training taps, or a sample is NaN or infinite.
            ZeroEvidenceError: A tap is impossible under every label, as can happen with `pseudocount=0`.
        """
        check_is_fitted(self)
        log_joint = self.model_.log_likelihood(self._taps(X, reset=False)) + self.model_.log_prior
        log_joint = log_fold(log_joint[:, 0], len(self.classes_))
        log_evidence = np.logaddexp.reduce(log_joint, axis=1, keepdims=True)
        if np.isneginf(log_evidence).any():
            raise ZeroEvidenceError(f"Tap {np.isneginf(log_evidence).argmax()} is impossible under every label.")
        return log_joint - log_evidence

    def predict_proba(self, X: ArrayLike) -> NDArray[np.float64]:
        """Posterior probability of each label after one tap, shape (N, M); Eq. 3. Raises as `predict_log_proba`."""
        return np.exp(self.predict_log_proba(X))

    def predict(self, X: ArrayLike) -> NDArray[Any]:
        """The most probable label of each tap, shape (N,). Raises as `predict_log_proba`."""
        best = self.predict_log_proba(X).argmax(axis=1)
        return self.classes_[best]

    def __sklearn_tags__(self) -> Any:
        """Tags of the estimator: taps have three axes."""
        tags = super().__sklearn_tags__()
        tags.input_tags.two_d_array, tags.input_tags.three_d_array = False, True
        return tags

    def _taps(self, X: Any, y: Any = "no_validation", *, reset: bool) -> Any:
        """Checked taps, and their labels if given."""
        checked: Any = validate_data(self, X, y, reset=reset, allow_nd=True)
        taps = checked if isinstance(y, str) else checked[0]
        if taps.ndim != 3:
            raise InputError(f"X must have three axes (tap, sample, taxel), got shape {taps.shape}.")
        return checked

    def _labelled(self, X: ArrayLike, y: ArrayLike, reset: bool) -> tuple[NDArray[np.floating], NDArray[Any]]:
        taps, labels = self._taps(X, y, reset=reset)
        check_classification_targets(labels)
        return taps, labels

    @undone_on_error()
    def _fitted(
        self, taps: NDArray[np.floating], what: ArrayLike, classes: Sequence[Any] | NDArray[Any], session: Any
    ) -> TapModel:
        """Model fitted to taps with label indices."""
        settings = {name: getattr(self, name) for name in FitSettings.__struct_fields__ if hasattr(self, name)}
        labelled = TapSet.from_arrays(
            taps,
            what,
            [str(label) for label in classes],
            preprocessing=Preprocessing(taps.shape[1]),
            session=None if session is None else np.unique(np.asarray(session), return_inverse=True)[1],
        )
        given = FitSettings(**settings)
        name = model_name(self.model)
        check_used(name, given)
        fitted, _ = fit_tempered(name, labelled, labelled.grid(), given, "TapClassifier")
        return fitted.model


def _joined(first: Any, second: Any) -> HistogramModel:
    """Histogram model of the training taps of two models with the same bins."""
    if not np.array_equal(first.edges, second.edges):
        raise InputError("The bin edges differ from those of earlier calls.")
    counts = first.counts + second.counts
    return replace(
        second,
        counts=counts,
        training=np.concatenate([first.training, second.training]),
        left_out=second.grid.untouched(counts.sum(axis=(2, 3)) > 0),
    )
