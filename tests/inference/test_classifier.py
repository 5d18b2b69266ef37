"""Measurement models as classifiers of scikit-learn, by its own checks and by the reference equations."""

import inspect
import pickle
from importlib.metadata import version

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

from benchmarks.checks.house import ROOT
from benchmarks.page import block_of
from benchmarks.peers import estimator

EDGES = np.linspace(-3.0, 13.0, 21)


@pytest.fixture(scope="module")
def taps(make_taps):
    return make_taps(L=1, sessions=3)


@pytest.fixture(scope="module")
def labels(taps):
    return np.array(taps.what_name)[taps.what]


@pytest.mark.parametrize("name", estimator.CHECKED)
def test_the_checks_of_scikit_learn_pass(name):
    """All that run on tables, but those of which `EXPECTED_TO_FAIL` says why."""
    found = estimator.results(name)
    skipped = {check for check, (status, _) in found.items() if status == "skipped"}

    assert {check: message for check, (status, message) in found.items() if status == "failed"} == {}
    assert {check for check, (status, _) in found.items() if status == "xfail"} == {
        *estimator.EXPECTED_TO_FAIL.get(name, {})
    }
    assert skipped <= {"check_array_api_input"}
    if version("scikit-learn").startswith("1.9."):
        assert {*found} == estimator.every_check() - {check for of in estimator.NOT_RUN.values() for check in of}


def test_the_page_says_which_checks_do_not_run_and_why():
    page = block_of(ROOT / "docs" / "how-to" / "scikit-learn.md", estimator.BLOCK)
    expected = estimator.ran_table({name: {} for name in estimator.CHECKED}).splitlines()

    assert page.endswith(estimator.not_run_table())
    assert [line.split("|")[1::2] for line in page.splitlines()[2 : 2 + len(expected)]] == [
        line.split("|")[1::2] for line in expected
    ]


def test_scikit_learn_checks_nothing_on_taps_with_three_axes():
    """Which is why they run on tables."""
    with pytest.warns(UserWarning, match="Can't test estimator"):
        assert len(check_estimator(TapClassifier())) == 1


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
    classifier = TapClassifier(**arguments)
    assert not hasattr(classifier, "partial_fit")
    with pytest.raises(AttributeError, match="has no attribute 'partial_fit'") as raised:
        classifier.partial_fit(taps.taps, labels, classes=labels)
    assert "partial_fit requires model='histogram' with given edges" in str(raised.value.__cause__)


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
