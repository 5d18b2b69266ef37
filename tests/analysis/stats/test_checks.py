"""What predictive checks measure, against definitions written out, and taps drawn from tables."""

import numpy as np
import pytest
from scipy.stats import spearmanr
from solidtouch.analysis.stats.checks import STATISTICS, BinnedTaps, TapLabels, observed_statistics, replicate
from solidtouch.analysis.stats.evidence import halves, rivals
from solidtouch.models.measurement.histogram import HistogramModel, fit
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.taps import TapSet

L, M, J, K, B = 2, 3, 5, 4, 8
EDGES = np.linspace(-4.0, 4.0, B + 1)


@pytest.fixture(scope="module")
def taps() -> TapSet:
    """Two sessions, 9 taps of each class and session at places of their own, shuffled; taxel 2 is dead."""
    rng = np.random.default_rng(7)
    session, _, where, what = (index.ravel() for index in np.indices((2, 9, L, M)))
    N = len(what)
    place = where + rng.uniform(-0.5, 0.5, size=N)
    values = 0.5 * what[:, None, None] - where[:, None, None] + rng.normal(size=(N, J, K))
    values += 0.4 * session[:, None, None] + rng.normal(size=(N, 1, 1)) * 0.5 + place[:, None, None]
    values[..., 2] = 0.7
    order = rng.permutation(N)
    return TapSet.from_arrays(
        values[order],
        what[order],
        ["a", "b", "c"],
        where=place[order],
        where_value=np.arange(L, dtype=float),
        where_edges=np.arange(L + 1) - 0.5,
        session=session[order],
        trial=np.arange(N),
        preprocessing=Preprocessing(samples=J),
    )


@pytest.fixture(scope="module")
def loops(taps) -> dict[str, float]:
    """The statistics by loops over classes, taps and pairs."""
    values = np.clip(np.floor(taps.taps.astype(float)), -4, 3) + 0.5
    grid = taps.grid()
    where, what = taps.indices(grid)
    own = where * M + what
    residual, mean = values.copy(), {}
    for c in np.unique(own):
        mean[c] = values[own == c].mean(axis=0)
        residual[own == c] -= mean[c]
    total = (residual**2).sum()
    live = [0, 1, 3]
    pairs = [(k, m) for i, k in enumerate(live) for m in live[:i]]
    between = np.mean([mean[c].var(axis=0).mean() for c in mean])
    r, s = residual[:, :-1].ravel(), residual[:, 1:].ravel()
    everywhere = np.mean(list(mean.values()), axis=(0, 1))
    strength, places, sessions, beyond, counted = 0.0, 0.0, 0.0, 0, 0
    for c, tap in mean.items():
        members = np.flatnonzero(own == c)
        way = (tap - everywhere).ravel()
        strength += sum(float(residual[n].ravel() @ way) ** 2 for n in members) / float(way @ way)
        x = taps.where[members] - taps.where[members].mean()
        slope = np.tensordot(x, residual[members], 1) / (x @ x)
        places += float((slope**2).sum() * (x @ x))
        for number in (0, 1):
            group = residual[members[taps.session[members] == number]]
            sessions += len(group) * float((group.mean(axis=0) ** 2).sum())
        for k in live:
            deviation = np.sqrt((residual[members][..., k] ** 2).mean())
            beyond += int((np.abs(residual[members][..., k]) > 3 * deviation).sum())
            counted += residual[members][..., k].size
    strata = [np.flatnonzero((own == c) & (taps.session == number)) for c in mean for number in (0, 1)]
    rho = {pair: [] for pair in pairs}
    for stratum in strata:
        for j in range(J):
            for k, m in pairs:
                rho[k, m].append(spearmanr(values[stratum, j, k], values[stratum, j, m]).statistic)
    flat = residual.reshape(-1, K)
    return {
        "profile": between / (between + (residual**2).mean()),
        "lag": (r * s).mean() / np.sqrt((r**2).mean() * (s**2).mean()),
        "taxels": np.mean([abs(np.corrcoef(flat[:, k], flat[:, m])[0, 1]) for k, m in pairs]),
        "ranks": np.mean([abs(np.mean(rho[pair])) for pair in pairs]),
        "gain": strength / total,
        "design": design_effect(taps, own),
        "tails": beyond / counted,
        "place": places / total,
        "sessions": sessions / total,
    }


def design_effect(taps, own) -> float:
    """Variance of the log-likelihood ratio over the sum of those of its samples, the median over classes."""
    grid = taps.grid()
    half = halves(taps, grid)
    models = [fit(taps.select(half != h), grid, bins=B, edges=EDGES, power="none") for h in (0, 1)]
    effects = []
    for c in np.unique(own):
        whole, single = 0.0, 0.0
        for h, model in enumerate(models):
            rival = rivals(model, model.trained)[c]
            table = model.log_prob.reshape(-1, K, B)
            for number in (0, 1):
                group = np.flatnonzero((own == c) & (half == h) & (taps.session == number))
                bins = np.clip(np.floor(taps.taps[group] + 4.0), 0, B - 1).astype(int)
                ratio = np.array(
                    [[[table[c, k, b] - table[rival, k, b] for k, b in enumerate(row)] for row in tap] for tap in bins]
                )
                ratio -= ratio.mean(axis=0)
                whole += (ratio.sum(axis=(1, 2)) ** 2).sum()
                single += (ratio**2).sum()
        effects.append(whole / single)
    return float(np.median(effects))


@pytest.mark.parametrize("name", STATISTICS)
def test_statistics_are_what_loops_make_of_the_taps(taps, loops, name):
    """Every statistic agrees with its definition, with a dead taxel and taps in any order."""
    found = observed_statistics(TapLabels.of(taps, taps.grid()), EDGES)

    assert found[name] == pytest.approx(loops[name], rel=1e-9)


def test_the_order_in_which_taps_are_given_does_not_matter(taps):
    """Taps given backwards, with their trials, have the same statistics."""
    backwards = taps.select(np.arange(len(taps))[::-1])
    first, second = (observed_statistics(TapLabels.of(part, taps.grid()), EDGES) for part in (taps, backwards))

    assert first == pytest.approx(second, rel=1e-9)


def test_one_tap_of_a_class_and_session_says_nothing_of_sessions(taps):
    """What differs between single taps is not what differs between sessions."""
    grid = taps.grid()
    where, what = taps.indices(grid)
    _, first = np.unique((taps.session * L + where) * M + what, return_index=True)
    found = observed_statistics(TapLabels.of(taps.select(first), grid), EDGES)

    assert set(found) == {"profile", "lag", "taxels", "gain", "tails"}


def test_one_sample_of_one_taxel_has_no_dependence_within_a_tap():
    """Statistics of time, taxels and strength are left out, as is evidence without a rival."""
    rng = np.random.default_rng(3)
    taps = TapSet.from_arrays(
        rng.normal(size=(30, 1, 1)), np.zeros(30, dtype=int), ["a"], preprocessing=Preprocessing(samples=1)
    )

    assert set(observed_statistics(TapLabels.of(taps, taps.grid()), EDGES)) == {"tails"}


def test_a_constant_recording_shows_nothing():
    """Without any variance there is neither correlation nor a tail, and no warning."""
    taps = TapSet.from_arrays(
        np.full((12, 3, 2), 0.1), np.repeat([0, 1], 6), ["a", "b"], preprocessing=Preprocessing(samples=3)
    )
    found = observed_statistics(TapLabels.of(taps, taps.grid()), EDGES)

    assert found == {"profile": 0.0}


def test_replicates_follow_the_tables_of_their_classes(taps):
    """Frequencies of bins are those of the tables within sampling error, and samples of a tap do not repeat."""
    rng = np.random.default_rng(0)
    grid = taps.grid()
    p = rng.dirichlet(np.ones(B), size=(L, M, K))
    model = HistogramModel(grid, EDGES, "none", taps.preprocessing, np.ones((L, M, K, B), int), 0.01)
    labels = TapLabels.of(taps, grid)
    counts, repeats = np.zeros((L, M, K, B)), []
    for _ in range(200):
        made = replicate({"log_prob": np.log(p)}, model, labels, rng)
        bins = made.cell.reshape(made.residual.shape) - np.arange(K) * B
        for k in range(K):
            np.add.at(counts, (labels.where[:, None], labels.what[:, None], k, bins[..., k]), 1)
        repeats.append((bins[:, 1:] == bins[:, :-1]).mean())
    n = counts.sum(axis=-1, keepdims=True)

    assert n.min() == 200 * 18 * J
    assert np.abs((counts / n - p) / np.sqrt(p * (1 - p) / n)).max() < 4.5
    assert np.mean(repeats) == pytest.approx((p**2).sum(axis=-1).mean(), abs=0.003)


def test_cells_hold_the_middle_of_bins(taps):
    """Mean taps and residuals add up to bin centres."""
    labels = TapLabels.of(taps, taps.grid())
    bins = np.random.default_rng(1).integers(0, B, size=labels.taps.taps.shape)
    cells = BinnedTaps.of(labels, bins, EDGES)
    own = np.repeat(np.arange(L * M), np.diff(labels.classes))

    np.testing.assert_allclose(cells.mean[own] + cells.residual, bins - 3.5)
