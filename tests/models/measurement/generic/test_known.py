"""Classes about which a function says something without their taps."""

import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from scipy import stats
from solidtouch.analysis.compare.groups import folds_of, scorer
from solidtouch.models.measurement.generic import fit as fits
from solidtouch.models.measurement.generic.contract import StoryCall, StoryFunction
from solidtouch.models.measurement.generic.known import known_classes
from solidtouch.models.measurement.generic.runs import Program
from solidtouch.models.measurement.generic.structure import shapes_of, structure_of
from solidtouch.models.measurement.registry import fit_model, model_name
from solidtouch.models.settings import FitSettings

L, M, J, K = 4, 3, 2, 2
COVERED = np.array([[1, 1, 0], [1, 0, 0], [0, 0, 0], [1, 0, 0]], dtype=bool)


def at(level_of):
    """Levels `level_of(where, what, L, M, where_value, what_value)` of each tap, shape (N,)."""

    def story(where, what, taps=None, *, L, M, J, K, where_value, what_value, session):
        level = level_of(where, what, L, M, where_value, what_value)
        with numpyro.plate("S", int(session.max()) + 1):
            shift = numpyro.sample("shift", dist.Normal(0.0, 1.0))
        with numpyro.plate("tap", len(where), dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("K", K, dim=-1):
            numpyro.sample("taps", dist.Normal((level + shift[session])[:, None, None], 1.0), obs=taps)

    return story


def normal(name, *shape):
    return numpyro.sample(name, dist.Normal(0.0, 1.0).expand(shape))


def slopes(where, what, L, M, where_value, what_value):
    return normal("a") * where_value[where] + normal("b") * what_value[what]


def of_objects(where, what, L, M, where_value, what_value):
    return normal("a") * where_value[where] + normal("b", M)[what]


def added(where, what, L, M, where_value, what_value):
    return normal("a", L)[where] + normal("b", M)[what]


def cells(where, what, L, M, where_value, what_value):
    return normal("a", L, M)[where, what]


def flattened(where, what, L, M, where_value, what_value):
    return normal("a", L * M)[where * M + what]


def numbered(where, what, L, M, where_value, what_value):
    return normal("a", 4)[where]


def one_by_one(where, what, L, M, where_value, what_value):
    return jnp.stack([normal(f"a{l}") for l in range(L)])[where]


ROWS, COLUMNS = COVERED.any(axis=1, keepdims=True), COVERED.any(axis=0, keepdims=True)


@pytest.mark.parametrize(
    ("level_of", "expected"),
    [
        (slopes, np.ones((L, M), bool)),
        pytest.param(of_objects, COLUMNS, marks=pytest.mark.slow),
        (added, ROWS & COLUMNS),
        pytest.param(cells, COVERED, marks=pytest.mark.slow),
        (flattened, COVERED),
        pytest.param(numbered, ROWS, marks=pytest.mark.slow),
        pytest.param(one_by_one, ROWS, marks=pytest.mark.slow),
    ],
)
def test_a_class_is_known_if_all_its_latent_variables_have_taps(level_of, expected):
    values = np.arange(L) / 2, np.arange(M) + 1.0
    batch = StoryCall(*np.zeros((2, 0), int), (L, M, J, K), *map(jnp.asarray, values), session=np.zeros(0, int))
    story = StoryFunction.of(at(level_of), "story")
    latents = {name: np.zeros(shape) for name, shape in shapes_of(story, batch).items()}
    latents["shift"] = np.zeros(5)
    program = Program(story, structure_of(story, batch, 5), batch, 5)

    np.testing.assert_array_equal(known_classes(program, latents, COVERED), np.broadcast_to(expected, (L, M)))
    assert known_classes(program, latents, np.ones((L, M), bool)).all()


def sloped(where, what, taps=None, *, M, J, K, where_value):
    """Levels of an object, linear in the position."""
    with numpyro.plate("M", M):
        loc = numpyro.sample("loc", dist.Normal(0.0, 3.0))
    slope = numpyro.sample("slope", dist.Normal(0.0, 1.0))
    level = loc[what] + slope * where_value[where]
    with numpyro.plate("tap", len(where), dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("K", K, dim=-1):
        numpyro.sample("taps", dist.Normal(level[:, None, None], 1.0), obs=taps)


def test_a_left_out_position_is_judged_by_the_function_there(make_taps, monkeypatch):
    """As by SciPy, not by the mean over positions with taps; also where `compare` leaves it out."""
    values = {"loc": np.array([-1.0, 0.2, 1.1]), "slope": np.array(0.3)}
    found = fits.GuidePosterior(values, lambda _: values, fits.Convergence(True, "Set by hand.", {}))
    monkeypatch.setattr(fits, "posterior", lambda *_: found)
    monkeypatch.setattr(fits, "check_prior", lambda _: "")
    taps = make_taps(L, M, J, K, repeats=2)
    grid = taps.grid()
    folds, _ = folds_of("position", taps, taps, grid, L)
    left = folds[2]
    fitted = fit_model(model_name(sloped), left.train, grid, FitSettings(bins=9, power="none", method="map"))
    model = fitted.model
    edges = np.concatenate([[-np.inf], model.edges[1:-1], [np.inf]])
    _, what = left.test.indices(grid)
    bins = model.bins(left.test.taps)
    lower, upper = ((edges[b] - model.scaling.centre) / model.scaling.unit for b in (bins, bins + 1))
    level = (values["loc"][what] + 0.3 * grid.where_value[2])[:, None, None]
    expected = np.log(stats.norm.cdf(upper - level) - stats.norm.cdf(lower - level)).sum(axis=(1, 2))

    assert not (left.train.indices(grid)[0] == 2).any()
    assert model.trained.all()
    assert model.left_out == ()
    scores = scorer("position", folds, grid, 0)(fitted, left.test, 1.0)
    np.testing.assert_allclose(scores["plug_in"].values, expected, rtol=1e-6)
    np.testing.assert_allclose(scores["integrated"].values, expected, rtol=1e-6)
