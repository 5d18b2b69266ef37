"""Stories of the reference posteriors have the log densities that their page states, here in NumPy and SciPy."""

import json
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest
from numpyro import handlers
from numpyro.infer.util import log_density
from scipy import stats
from slow_cases import slow_but
from solidtouch.analysis.posteriors import catalogue
from solidtouch.models.measurement import profile
from solidtouch.models.measurement.likelihood.shapes import Measure
from solidtouch.models.measurement.model import in_states
from solidtouch.models.measurement.scaling import Scaling
from solidtouch.models.measurement.states import States

from benchmarks.posteriors.targets import session_data, session_probability, targets


def data_of(name):
    """The data file, as a program in another language reads it; classes count from 0."""
    data = json.loads((Path(catalogue.__file__).parent / "data" / f"{name}.data.json").read_text(encoding="utf-8"))
    arrays = {key: np.array(value) if isinstance(value, list) else value for key, value in data.items()}
    return arrays | {"c": (arrays["where"] - 1, arrays["what"] - 1)}


def cells(level, variance):
    """Prior of levels and variances."""
    prior = stats.invgamma.logpdf(variance, 2, scale=2)
    return (prior + stats.norm.logpdf(level, 0, np.sqrt(variance / 0.01))).sum()


def normal(data, mean, variance):
    return stats.norm.logpdf(data["taps"], mean, np.sqrt(variance[data["c"]])).sum()


def histogram(data, p):
    edges, widths = data["edges"], np.diff(data["edges"])
    total = stats.dirichlet.logpdf(np.full(len(widths), 1 / len(widths)), np.ones(len(widths))) * p[..., 0].size
    for n, (l, m) in enumerate(zip(*data["c"], strict=True)):
        for (_, k), x in np.ndenumerate(data["taps"][n]):
            b = min(max(int((edges <= x).sum()) - 1, 0), len(widths) - 1)
            total += np.log(p[l, m, k, b] / widths[b])
    return total


def gaussian(data, level, variance):
    return cells(level, variance) + normal(data, level[data["c"]], variance)


def student(data, freedom, spread, typical, variety, level, scale):
    prior = stats.gamma.logpdf(freedom, 2, scale=10) + stats.halfcauchy.logpdf(spread, scale=5)
    prior = prior + stats.norm.logpdf(typical, 0, 2) + stats.halfnorm.logpdf(variety)
    classes = stats.norm.logpdf(level, 0, spread) + stats.lognorm.logpdf(scale, variety, scale=np.exp(typical))
    taps = stats.t.logpdf(data["taps"], freedom, level[data["c"]], scale[data["c"]])
    return prior.sum() + classes.sum() + taps.sum()


def profile_ar(data, rho, level, variance):
    before = np.zeros_like(data["taps"])
    before[:, 1:] = data["taps"][:, :-1]
    slopes = len(rho) * np.log(1 / 2)
    return slopes + cells(level, variance) + normal(data, level[data["c"]] + rho * before, variance)


def profile_mvn(data, slope, level, variance):
    mean = level[data["c"]].copy()
    mean[:, :, 1] += slope[data["c"]] * data["taps"][:, :, 0]  # one pair of two taxels
    return stats.norm.logpdf(slope, 0, 0.5).sum() + cells(level, variance) + normal(data, mean, variance)


def matrix_normal(data, time, taxel, level):
    J, K = data["J"], data["K"]
    total = stats.wishart.logpdf(time, J + 2, np.eye(J) / (J + 2))
    rows: Any = np.linalg.inv(time)
    for l, m in np.ndindex(data["L"], data["M"]):
        columns: Any = np.linalg.inv(taxel[l, m])
        total += stats.wishart.logpdf(taxel[l, m], K + 2, np.eye(K) / (K + 2))
        total += stats.matrix_normal.logpdf(level[l, m], np.zeros((J, K)), rows / 0.01, columns)
        own = (data["c"][0] == l) & (data["c"][1] == m)
        total += stats.matrix_normal.logpdf(data["taps"][own], level[l, m], rows, columns).sum()
    return total


def smooth(data, weight, variance):
    prior = stats.norm.logpdf(weight, 0, data["width"][:, None, None, None]).sum()
    curve = np.einsum("ld,dmjk->lmjk", data["basis"], weight)
    return prior + stats.invgamma.logpdf(variance, 2, scale=2).sum() + normal(data, curve[data["c"]], variance)


BY_HAND = {
    "histogram": histogram,
    "gaussian": gaussian,
    "student": student,
    "profile": gaussian,
    "profile-ar": profile_ar,
    "profile-mvn": profile_mvn,
    "matrix-normal": matrix_normal,
    "smooth": smooth,
}


@pytest.mark.parametrize("name", slow_but(["gaussian"], BY_HAND))
def test_the_log_density_is_the_documented_one(name):
    """At parameters from the prior, all constants included."""
    (target,), data = (target for target in targets() if target.name == name), data_of(name)
    with jax.enable_x64(True):
        trace = handlers.trace(handlers.seed(target.story, 3)).get_trace()
        sites = {key: np.asarray(trace[key]["value"]) for key in target.scales}
        found = float(log_density(target.story, (), {}, sites)[0])

    assert found == pytest.approx(BY_HAND[name](data, **sites), rel=1e-9)


def test_the_session_posterior_is_that_of_the_fitted_model():
    """In states, over the bins of all taps."""
    data = session_data()
    L, M, _, K = data["level"].shape
    parameters = {"level": data["level"], "variance": data["deviation"] ** 2}
    plain = profile.form(parameters, Measure(Scaling(np.zeros(K), np.ones(K)), data["edges"], np.zeros((0, 0, 0))))
    states = States(data["gain"], data["offset"], data["log_prior"])
    prepared = in_states(plain, states, data["edges"]).prepare(np.zeros((L, M * len(data["gain"])), dtype=bool))
    each = np.empty((len(data["taps"]), L, M * len(data["gain"])))
    prepared.log_likelihood(data["taps"], data["edges"], 1.0, each)
    log_belief = each.sum(axis=0) + np.repeat(data["log_prior"], M)
    belief = np.exp(log_belief - log_belief.max())
    belief = (belief / belief.sum()).reshape(L, -1, M).swapaxes(1, 2)

    np.testing.assert_allclose(session_probability(data), belief, atol=1e-9)
