"""scikit-learn's checks of estimators on `TapClassifier`: which run, and why the others do not.

    SCIPY_ARRAY_API=1 python -m benchmarks.peers.estimator --document docs/how-to/scikit-learn.md

SciPy reads the variable when it is loaded; without it scikit-learn skips one check.

The checks make tables of two axes, and taps have three. So they run on taps of one sample, whose taxels are the
columns, and on taps of one taxel, whose samples are the columns.
"""

import sys
import warnings
from argparse import ArgumentParser
from importlib.metadata import version
from typing import Any

import numpy as np
from sklearn.utils import estimator_checks
from sklearn.utils.validation import validate_data
from solidtouch.inference.classifier import TapClassifier

from benchmarks.page import parsed, table, write_block

BLOCK = "estimator checks"


class OneSample(TapClassifier):
    """Rows of a table as taps of one sample."""

    def _taps(self, X: Any, y: Any = "no_validation", *, reset: bool) -> Any:
        checked: Any = validate_data(self, X, y, reset=reset)
        return self._with_axis(checked) if isinstance(y, str) else (self._with_axis(checked[0]), checked[1])

    def _with_axis(self, X: Any) -> Any:
        return X[:, None]

    def __sklearn_tags__(self) -> Any:
        """Tags of the estimator: tables have two axes."""
        tags = super().__sklearn_tags__()
        tags.input_tags.two_d_array, tags.input_tags.three_d_array = True, False
        return tags


class OneTaxel(OneSample):
    """Rows of a table as taps of one taxel."""

    def _with_axis(self, X: Any) -> Any:
        return X[:, :, None]


CHECKED: dict[str, TapClassifier] = {
    "histogram": OneSample(),
    "histogram with given edges, which has `partial_fit`": OneSample(edges=np.linspace(-10, 10, 81), pseudocount=0.5),
    "gaussian": OneSample("gaussian"),
    "profile, on taps of one taxel": OneTaxel("profile"),
}
"""What is checked, by the name in the table."""

EXPECTED_TO_FAIL = {
    "profile, on taps of one taxel": {
        "check_fit2d_1feature": "A profile needs more than one sample per tap. It says so, but not in the words that "
        "the check looks for, in which samples are features.",
    },
}
"""By what is checked and the check: why it fails."""

NOT_RUN = {
    "no transformer, so nothing is transformed in place either": (
        "check_get_feature_names_out_error",
        "check_global_output_transform_pandas",
        "check_global_set_output_transform_polars",
        "check_inplace_ensure_writeable",
        "check_set_output_transform",
        "check_set_output_transform_pandas",
        "check_set_output_transform_polars",
        "check_transformer_data_not_an_array",
        "check_transformer_general",
        "check_transformer_get_feature_names_out",
        "check_transformer_get_feature_names_out_pandas",
        "check_transformer_n_iter",
        "check_transformer_preserve_dtypes",
        "check_transformers_unfitted",
        "check_transformers_unfitted_stateless",
    ),
    "no regressor": (
        "check_regressor_data_not_an_array",
        "check_regressor_multioutput",
        "check_regressors_int",
        "check_regressors_no_decision_function",
        "check_regressors_train",
    ),
    "no clustering": ("check_clusterer_compute_labels_predict", "check_clustering"),
    "no detector of outliers ([unknown objects](../explanation/unknown-objects.md) are told by whole episodes)": (
        "check_outlier_contamination",
        "check_outlier_corruption",
        "check_outliers_fit_predict",
        "check_outliers_train",
    ),
    "no weights of samples: a tap counts once": (
        "check_all_zero_sample_weights_error",
        "check_sample_weight_equivalence_on_dense_data",
        "check_sample_weight_equivalence_on_sparse_data",
        "check_sample_weights_list",
        "check_sample_weights_not_an_array",
        "check_sample_weights_not_overwritten",
        "check_sample_weights_pandas_series",
        "check_sample_weights_shape",
    ),
    "no weights of classes: the prior is uniform": (
        "check_class_weight_balanced_classifiers",
        "check_class_weight_balanced_linear_classifier",
        "check_class_weight_classifiers",
    ),
    "one label per tap, of any number of labels": (
        "check_classifier_multioutput",
        "check_classifier_not_supporting_multiclass",
        "check_classifiers_multilabel_output_format_decision_function",
        "check_classifiers_multilabel_output_format_predict",
        "check_classifiers_multilabel_output_format_predict_proba",
        "check_classifiers_multilabel_representation_invariance",
    ),
    "arrays of NumPy only": (
        "check_array_api_input_and_values",
        "check_array_api_mixed_inputs",
        "check_array_api_same_namespace",
    ),
    "samples may be negative, and are no distances between taps": ("check_fit_non_negative", "check_nonsquare_error"),
    "no coefficients to make sparse": ("check_sparsify_coefficients",),
    "of scikit-learn's own classes alone, which declare `_parameter_constraints`": ("check_param_validation",),
    "part of other checks, or helpers that `estimator_checks` imports": (
        "check_classifiers_predictions",
        "check_estimator",
        "check_estimators_data_not_an_array",
        "check_is_fitted",
    ),
}
"""By the reason: the checks that scikit-learn does not run on these classifiers."""

EXTRA = ("check_dataframe_column_names_consistency",)
"""What scikit-learn runs on its own classes alone, but applies."""


def every_check() -> set[str]:
    """Names of all checks of the installed scikit-learn."""
    return {name for name, value in vars(estimator_checks).items() if name.startswith("check_") and callable(value)}


def results(name: str) -> dict[str, tuple[str, str]]:
    """Status and message by check, of one of `CHECKED`; a check that runs several times has its worst status."""
    expected = EXPECTED_TO_FAIL.get(name, {})
    found: dict[str, tuple[str, str]] = {}
    order = ["passed", "skipped", "xfail", "failed"]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        ran = estimator_checks.check_estimator(
            CHECKED[name], expected_failed_checks=expected, on_fail=None, on_skip=None
        )
    for one in ran:
        check, status = one["check_name"], one["status"]
        if order.index(status) >= order.index(found.get(check, ("passed", ""))[0]):
            found[check] = status, str(one["exception"] or "")
    for check in EXTRA:
        try:
            getattr(estimator_checks, check)(name, CHECKED[name])
            found[check] = "passed", ""
        except Exception as error:
            found[check] = "failed", str(error)
    return found


def ran_table(found: dict[str, dict[str, tuple[str, str]]]) -> str:
    """What ran, from `results` by name."""
    lines = []
    for name, checks in found.items():
        failing = [f"`{check}`: {reason}" for check, reason in EXPECTED_TO_FAIL.get(name, {}).items()]
        passed = sum(status == "passed" for status, _ in checks.values())
        lines.append([name, f"{passed} of {len(checks)}", " ".join(failing) or "-"])
    return table(["model", "checks passed", "expected to fail"], lines)


def not_run_table() -> str:
    """What does not run, and why."""
    lines = [[why, ", ".join(f"`{check}`" for check in checks)] for why, checks in NOT_RUN.items()]
    return table(["because", "checks that do not run"], lines)


def main() -> None:
    """Runs the checks and writes the page; exit code 1 if one fails that should not."""
    options = parsed(ArgumentParser(description=__doc__), BLOCK)
    found = {name: results(name) for name in CHECKED}
    text = "\n\n".join(
        [f"With scikit-learn {version('scikit-learn')}, by `make peers`:", ran_table(found), not_run_table()]
    )
    print(text)
    write_block(options.document, BLOCK, text)
    failed = [f"{name}: {check}" for name, of in found.items() for check, one in of.items() if one[0] == "failed"]
    sys.exit("\n".join(failed) or None)


if __name__ == "__main__":
    main()
