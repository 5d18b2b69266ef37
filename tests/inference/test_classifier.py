"""Measurement models as classifiers of scikit-learn, by its own checks and by the reference equations."""

import inspect
import pickle

import numpy as np
import pytest
from solidtouch.inference import reference
from solidtouch.inference.classifier import TapClassifier
from solidtouch.inference.fit import fit
from solidtouch.inference.reference import ZeroEvidenceError
from solidtouch.models.errors import InputError
from solidtouch.models.settings import FitSettings

pytest.importorskip("sklearn", reason="scikit-learn is not installed")

from sklearn.base import clone
from sklearn.exceptions import NotFittedError
from sklearn.model_selection import GridSearchCV, GroupKFold, cross_val_predict
from sklearn.pipeline import Pipeline
from sklearn.utils.estimator_checks import check_estimator
from sklearn.utils.validation import validate_data

EDGES = np.linspace(-3.0, 13.0, 21)


class OneSample(TapClassifier):
    """Rows of features as taps of one sample, on which scikit-learn's checks of estimators work."""

    partial_fit = property()  # it needs edges, which the checks do not give

    def _taps(self, X, y="no_validation", *, reset):
        checked = validate_data(self, X, y, reset=reset)
        return checked[:, None] if isinstance(y, str) else (checked[0][:, None], checked[1])

    def __sklearn_tags__(self):
        tags = super().__sklearn_tags__()
        tags.input_tags.two_d_array, tags.input_tags.three_d_array = True, False
        return tags


@pytest.fixture(scope="module")
def taps(make_taps):
    return make_taps(L=1, sessions=3)


@pytest.fixture(scope="module")
def labels(taps):
    return np.array(taps.what_name)[taps.what]


@pytest.mark.parametrize("model", ["histogram", "gaussian"])
def test_the_checks_of_scikit_learn_pass(model):
    """All of them on taps of one sample; those of data are skipped by scikit-learn itself for three axes."""
    estimator = OneSample(model, bins=20, pseudocount=0.5, value_range="taxel")
    results = check_estimator(estimator, on_fail=None, on_skip=None)

    failed = {result["check_name"]: result["exception"] for result in results if result["status"] == "failed"}
    assert failed == {}
    assert len(results) > 50
    with pytest.warns(UserWarning, match="Can't test estimator"):
        check_estimator(TapClassifier())


def test_its_parameters_are_the_settings_of_a_fit():
    """All but the saturation, which is about several taps."""
    parameters = inspect.signature(TapClassifier).parameters
    settings = {name: parameter.default for name, parameter in parameters.items() if name != "model"}
    defaults = FitSettings()

    assert settings == {name: getattr(defaults, name) for name in defaults.__struct_fields__ if name != "saturation"}


@pytest.mark.parametrize("power", ["J", "JK", "none", 0.3])
def test_probabilities_are_those_of_bayes_rule(taps, labels, power):
    """From raw samples by the reference alone, with the uniform prior whatever the numbers of taps."""
    training, test = np.arange(50), slice(50, None)
    classifier = TapClassifier(bins=9, power=power).fit(taps.taps[training], labels[training])
    names, what = np.unique(labels[training], return_inverse=True)
    edges = reference.bin_edges(taps.taps[training], 9)
    counts = reference.histogram_counts(taps.taps[training], edges, np.zeros_like(what), what, (1, len(names)))
    log_prob, prior = reference.log_histograms(counts), np.full((1, len(names)), 1 / len(names))
    expected = np.array(
        [
            reference.update(prior, reference.tap_log_likelihood(reference.tap_bins(tap, edges), log_prob, power))[0][0]
            for tap in taps.taps[test]
        ]
    )

    assert classifier.classes_.tolist() == names.tolist()
    np.testing.assert_allclose(classifier.predict_proba(taps.taps[test]), expected, rtol=1e-10)
    np.testing.assert_allclose(classifier.predict_log_proba(taps.taps[test]), np.log(expected), rtol=1e-10, atol=1e-12)
    assert classifier.predict(taps.taps[test]).tolist() == names[np.argmax(expected, axis=1)].tolist()


@pytest.mark.parametrize("model", ["histogram", "session", "profile", "session:gaussian"])
def test_the_model_is_that_of_fit(taps, labels, model):
    """With sessions, and with the states of an episode summed over."""
    classifier = TapClassifier(model, bins=9).fit(taps.taps, labels, session=taps.session * 10)
    fitted = fit(taps, model, bins=9)
    joint = fitted.log_likelihood(taps.taps[:5])[:, 0] + fitted.log_prior[0]
    joint = np.exp(joint - joint.max(axis=1, keepdims=True)).reshape(5, -1, fitted.grid.M).sum(axis=1)

    assert classifier.model_.name == model
    order = np.argsort(taps.what_name)
    np.testing.assert_allclose(
        classifier.predict_proba(taps.taps[:5]), (joint / joint.sum(axis=1, keepdims=True))[:, order], rtol=1e-9
    )


def test_labels_may_be_numbers(taps):
    for labels in (taps.what * 10 - 20, taps.what > 1, taps.what.astype(float)):
        classifier = TapClassifier().fit(taps.taps, labels)
        assert classifier.predict(taps.taps).dtype == labels.dtype
        assert classifier.score(taps.taps, labels) > 0.9
    with pytest.raises(ValueError, match="continuous"):
        TapClassifier().fit(taps.taps, taps.what + 0.5)


def test_it_is_searched_over_with_sessions_left_out(taps, labels):
    search = GridSearchCV(
        Pipeline([("touch", TapClassifier())]),
        {"touch__bins": [1, 30], "touch__power": ["J", 1.0]},
        cv=GroupKFold(3),
        error_score="raise",
    )
    search.fit(taps.taps, labels, groups=taps.session, touch__session=taps.session)

    assert search.best_params_["touch__bins"] == 30
    assert search.best_score_ > 0.9
    predicted = cross_val_predict(
        clone(search.best_estimator_), taps.taps, labels, groups=taps.session, cv=GroupKFold(3), method="predict_proba"
    )
    assert predicted.shape == (len(taps), 4)
    changed = search.best_estimator_.set_params(touch__pseudocount=2.0)
    assert changed["touch"].pseudocount == 2.0


@pytest.mark.parametrize("first_only", [False, True])
def test_parts_train_the_model_of_all_taps(taps, labels, first_only):
    """Also where the first part lacks an object, and after a whole fit."""
    cut = labels != "rod 2 mm" if first_only else np.arange(len(taps)) < 31
    whole = TapClassifier(edges=EDGES).fit(
        np.concatenate([taps.taps[cut], taps.taps[~cut]]), np.concatenate([labels[cut], labels[~cut]])
    )
    parts = TapClassifier(edges=EDGES)
    parts.partial_fit(taps.taps[cut], labels[cut], classes=whole.classes_[::-1])
    if first_only:
        assert parts.model_.left_out == ("rod 2 mm",)
        assert (parts.predict_proba(taps.taps)[:, whole.classes_ == "rod 2 mm"] == 0).all()
    parts.partial_fit(taps.taps[~cut], labels[~cut])

    for name in ("counts", "training", "edges", "trained"):
        np.testing.assert_array_equal(getattr(parts.model_, name), getattr(whole.model_, name))
    assert parts.model_.left_out == whole.model_.left_out == ()
    np.testing.assert_array_equal(parts.predict_proba(taps.taps), whole.predict_proba(taps.taps))
    twice = TapClassifier(edges=EDGES).fit(taps.taps[cut], labels[cut])
    if not first_only:
        twice.partial_fit(taps.taps[~cut], labels[~cut])
        np.testing.assert_array_equal(twice.predict_proba(taps.taps), whole.predict_proba(taps.taps))


@pytest.mark.parametrize(
    "arguments", [{}, {"model": "profile", "edges": EDGES}, {"edges": EDGES, "power": "learned"}], ids=str
)
def test_parts_are_refused_where_all_taps_are_needed_at_once(taps, labels, arguments):
    with pytest.raises(InputError, match="partial_fit requires model='histogram' with given edges"):
        TapClassifier(**arguments).partial_fit(taps.taps, labels, classes=labels)


def test_parts_must_go_together(taps, labels):
    classifier = TapClassifier(edges=EDGES)
    with pytest.raises(InputError, match="first call of partial_fit requires classes"):
        classifier.partial_fit(taps.taps, labels)
    with pytest.raises(InputError, match="'rod 2 mm' is not among the classes"):
        classifier.partial_fit(taps.taps, labels, classes=["rod 4 mm", "rod 6 mm"])
    classifier.partial_fit(taps.taps, labels, classes=labels)
    with pytest.raises(InputError, match="must stay those of the first call"):
        classifier.partial_fit(taps.taps, labels, classes=["rod 2 mm"])
    with pytest.raises(InputError, match="edges differ from those of earlier calls"):
        classifier.set_params(edges=EDGES + 1).partial_fit(taps.taps, labels)
    with pytest.raises(ValueError, match="features"):
        classifier.partial_fit(taps.taps[:, 1:], labels)


def test_wrong_taps_are_refused(taps, labels):
    classifier = TapClassifier()
    with pytest.raises(NotFittedError):
        classifier.predict(taps.taps)
    with pytest.raises(InputError, match="three axes"):
        classifier.fit(taps.taps[:, 0], labels)
    with pytest.raises(InputError, match="Unknown model 'histgram'"):
        TapClassifier("histgram").fit(taps.taps, labels)
    with pytest.raises(InputError, match="bins must be"):
        TapClassifier(bins=0).fit(taps.taps, labels)
    classifier.fit(taps.taps, labels)
    with pytest.raises(InputError, match="taxels"):
        classifier.predict(taps.taps[:, :, 1:])
    with pytest.raises(ValueError, match="infinity"):
        classifier.predict(np.full_like(taps.taps, np.inf))
    classifier.set_params(pseudocount=0).fit(taps.taps, labels)
    mixed = taps.taps[0].copy()
    mixed[0], mixed[1] = taps.taps.min(), taps.taps.max()
    with pytest.raises(ZeroEvidenceError, match="Tap 1 is impossible under every label"):
        classifier.predict([taps.taps[0], mixed])


def test_it_survives_pickling(taps, labels):
    classifier = TapClassifier().fit(taps.taps, labels)
    again = pickle.loads(pickle.dumps(classifier))  # noqa: S301

    np.testing.assert_array_equal(again.predict_proba(taps.taps), classifier.predict_proba(taps.taps))
