"""Posterior predictive checks of audits: what they find, what they do not, and how they are drawn."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from solidtouch.analysis.audit.checks import audit_checks, count_replicates, summarise_checks
from solidtouch.analysis.audit.figures_checks import figure_checks
from solidtouch.hardware.simulator.model_rig import draw_session
from solidtouch.models.errors import InputError
from solidtouch.models.measurement.histogram import HistogramModel, fit
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.taps import TapSet, concatenate

M, J, K = 3, 6, 4


def make(seed: int, **knobs: float) -> TapSet:
    """Two sessions of 25 taps of each of 3 objects: white noise, an exchangeable profile, and one disturbance."""
    rng = np.random.default_rng(seed)
    session, _, what = (index.ravel() for index in np.indices((2, 25, M)))
    N = len(what)
    taps = (1.0 + what)[:, None, None] * np.arange(1.0, K + 1) + rng.normal(size=(N, J, K))
    taps *= 1 + knobs.get("gain", 0.0) * rng.normal(size=(N, 1, 1))
    taps += knobs.get("common", 0.0) * rng.normal(size=(N, J, 1))
    taps += knobs.get("session", 0.0) * np.array([-1.0, 1.0])[session, None, None]
    lasting = rng.normal(size=(N, J, K))
    for j in range(1, J):
        lasting[:, j] = 0.9 * lasting[:, j - 1] + np.sqrt(1 - 0.81) * lasting[:, j]
    taps += knobs.get("lasting", 0.0) * lasting
    record = Preprocessing(samples=J)
    return TapSet.from_arrays(taps, what, ["a", "b", "c"], session=session, trial=np.arange(N), preprocessing=record)


def checked(taps: TapSet, replicates: int = 30) -> xr.Dataset:
    return summarise_checks(audit_checks(taps, fit(taps, taps.grid(), bins=40), 1, replicates))


@pytest.mark.parametrize("seed", range(4))
def test_a_true_model_passes(seed, make_model):
    """Taps drawn from histograms, sample by sample, do not differ from what these predict."""
    model = make_model(L=2, M=3, K=4, J=5, taps=200, seed=seed)
    taps = concatenate([draw_session(model, 12, seed, session) for session in (0, 1)])
    checks = checked(taps)

    assert not checks["differs"].any()
    assert np.abs(checks["z"]).max() < 4
    assert {"lag", "taxels", "ranks", "gain", "design", "sessions"} <= set(checks["statistic"].values)


@pytest.mark.parametrize(
    ("knob", "size", "found", "silent"),
    [
        ("common", 1.5, {"taxels", "ranks", "design"}, {"lag", "sessions"}),
        ("lasting", 1.0, {"lag", "design"}, {"taxels", "ranks", "sessions"}),
        ("gain", 0.2, {"taxels", "ranks", "lag", "gain", "design"}, {"sessions"}),
        ("session", 0.7, {"sessions"}, {"ranks"}),
    ],
)
def test_a_broken_assumption_is_found_where_it_breaks(knob, size, found, silent):
    """Statistics that the disturbance moves lie outside all replicates, others do not."""
    checks = checked(make(2, **{knob: size}))
    differ = set(checks["statistic"].values[checks["differs"].values])

    assert found <= differ
    assert not silent & differ


def test_the_tree_is_one_that_arviz_takes():
    """Variables over chain and draw stand beside observed ones of the same names, with words as attributes."""
    import arviz_plots as azp  # where it comes before NumPyro, it leaves a lazy one behind that lacks submodules

    taps = make(0)
    tree = audit_checks(taps, fit(taps, taps.grid()), 0, 7)
    predicted, observed = tree["posterior_predictive"].to_dataset(), tree["observed_data"].to_dataset()

    assert dict(predicted.sizes) == {"chain": 1, "draw": 7}
    assert set(predicted.data_vars) == set(observed.data_vars)
    assert not observed.sizes
    assert predicted["lag"].attrs == observed["lag"].attrs
    assert predicted["lag"].attrs["assumption"] == "independence in time"
    assert tree.attrs == {"replicates": 7, "wanted": 7, "taps": len(taps), "seed": 0}
    collection = azp.plot_ppc_tstat(tree, var_names=["lag", "taxels"], backend="none")
    assert set(collection.viz["plot"].data_vars) == {"lag", "taxels"}


def test_the_same_seed_gives_the_same_replicates():
    """And another one others; the first replicates of many are those of few."""
    taps = make(0)
    model = fit(taps, taps.grid())
    few, many, other = (
        audit_checks(taps, model, seed, n)["posterior_predictive"]["taxels"].values[0]
        for seed, n in ((3, 2), (3, 4), (4, 2))
    )

    np.testing.assert_array_equal(few, many[:2])
    assert (few != other).all()


def test_large_taps_are_judged_one_replicate_at_a_time(monkeypatch):
    """With the same values as several at a time."""
    taps = make(0)
    model = fit(taps, taps.grid())
    several = audit_checks(taps, model, 3, 4)
    monkeypatch.setattr("solidtouch.analysis.audit.checks._AT_ONCE", 1)

    assert audit_checks(taps, model, 3, 4).identical(several)


def test_taps_outside_the_classes_are_left_out_and_progress_counts_replicates(make_taps):
    """A model of two of four objects checks the taps of these."""
    taps = make_taps()
    grid = taps.grid()
    fewer = replace(grid, what_members=grid.what_members[:2], what_value=None)
    told: list[int] = []
    tree = audit_checks(taps, fit(taps, fewer), 0, 3, told.append)

    assert tree.attrs["taps"] == (taps.what < 2).sum()
    assert told == [1, 1, 1]


def test_many_taps_have_fewer_replicates():
    """As many as are wanted, or so many that it takes seconds, but at least forty."""

    class Sized:
        def __init__(self, size):
            self.samples = np.broadcast_to(0.0, (size,))

    assert count_replicates(Sized(1000)) == 100
    assert count_replicates(Sized(1000), 30) == 30
    assert count_replicates(Sized(3_000_000)) == 60
    assert count_replicates(Sized(30_000_000)) == 40


def test_what_cannot_be_checked_is_refused(make_taps, make_model):
    """One sentence says why."""
    taps = make(0)
    with pytest.raises(InputError, match="at least two replicates, got 1"):
        audit_checks(taps, fit(taps, taps.grid()), 0, 1)
    with pytest.raises(InputError, match="No tap belongs to a class of the model"):
        audit_checks(taps, make_model(K=K, J=J), 0, 5)


def tree_of(values: dict[str, list[float]], observed: dict[str, float]) -> xr.DataTree:
    """A tree of these replicates."""
    attributes = {name: {"long_name": f"{name} in words", "assumption": "none"} for name in values}
    predicted = {name: (("chain", "draw"), [value], attributes[name]) for name, value in values.items()}
    seen = {name: ((), value, attributes[name]) for name, value in observed.items()}
    draws = np.arange(len(next(iter(values.values()), range(5))))
    return xr.DataTree.from_dict(
        {
            "posterior_predictive": xr.Dataset(predicted, {"chain": [0], "draw": draws}),
            "observed_data": xr.Dataset(seen),
        }
    )


def test_where_observed_values_lie_is_counted():
    """The p-value counts the observed value among the replicates and both sides."""
    replicates = np.arange(9.0)
    tree = tree_of(
        {"far": [*replicates], "near": [*replicates], "edge": [*replicates], "still": [2.0] * 9, "moved": [2.0] * 9},
        {"far": 90.0, "near": 4.0, "edge": 0.0, "still": 2.0, "moved": 3.0},
    )
    checks = summarise_checks(tree)

    np.testing.assert_allclose(checks["p"], [0.2, 1.0, 0.4, 1.0, 0.2])
    np.testing.assert_allclose(checks["z"][:3], (np.array([90.0, 4.0, 0.0]) - 4.0) / replicates.std(ddof=1))
    assert checks["z"].values[3:].tolist() == [0.0, np.inf]
    assert checks["differs"].values.tolist() == [True, False, False, False, True]
    assert checks["low"].values[0] == pytest.approx(0.2)
    assert checks["label"].values[0] == "far in words"


@pytest.mark.parametrize("statistics", [1, 2, 5])
def test_every_statistic_has_a_row_that_holds_what_was_observed(statistics):
    """Replicates that are all the same or zero are drawn as well, far values lie within the axes, as do numbers."""
    rng = np.random.default_rng(0)
    names = ["same", "usual", "zero", "tiny", "wide"][:statistics]
    values = {name: rng.normal(size=20) for name in names} | {"same": np.full(20, 3.0)}
    values |= {name: values[name] * scale for name, scale in (("zero", 0.0), ("tiny", 1e-7)) if name in values}
    observed = dict(zip(names, (1.0, 40.0, 0.0, 1.0, -0.5), strict=False))
    tree = tree_of({name: [*values[name]] for name in names}, observed)
    figure = figure_checks(tree)
    (axes,) = figure.axes
    figure.canvas.draw()
    low, high = axes.get_xlim()
    seen = [line.get_xdata()[0] for line in axes.lines if line.get_marker() in ("D", "o")]

    assert [label.get_text().split(" ")[0] for label in axes.get_yticklabels()] == names
    assert len(seen) == len(axes.texts) == statistics
    assert all(low < value < high for value in seen)
    assert seen[0] == -1e6
    if statistics > 1:
        z = (40.0 - values["usual"].mean()) / values["usual"].std(ddof=1)
        assert seen[1] == pytest.approx(z)
        assert axes.texts[1].get_text().startswith("40, replicates ")


def test_what_differs_looks_different():
    """In colour and in mark: outside the replicates, and within."""
    values = np.random.default_rng(0).uniform(size=40)
    (axes,) = figure_checks(tree_of({"in": [*values], "out": [*values]}, {"in": 0.5, "out": 9.0})).axes
    marks = [line.get_marker() for line in axes.lines if line.get_marker() in ("D", "o")]

    assert marks == ["o", "D"]


def test_a_single_observed_one_is_no_warning():
    """A share of 1 or 0 is not taken for binary data."""
    assert figure_checks(tree_of({"share": [0.9, 0.95, 0.97]}, {"share": 1.0})) is not None


def test_without_a_statistic_there_is_no_figure():
    """Taps that show nothing leave no panels."""
    tree = tree_of({}, {})

    assert figure_checks(tree) is None
    assert not summarise_checks(tree).sizes["statistic"]


def test_a_model_without_a_pseudocount_is_checked_alike(make_taps):
    """The pseudocount gives replicates no samples in bins that no tap fell into."""
    taps = make_taps()
    models = [fit(taps, taps.grid(), pseudocount=pseudocount) for pseudocount in (0.0, 0.01, 5.0)]
    found = [audit_checks(taps, model, 0, 3)["posterior_predictive"].to_dataset() for model in models]

    assert isinstance(models[0], HistogramModel)
    for other in found[1:]:
        xr.testing.assert_identical(found[0], other)
