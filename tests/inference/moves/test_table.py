"""Tables of targets: learned from training taps, kept in files, looked up."""

import numpy as np
import pytest
from solidtouch.hardware.replay import ReplayRig
from solidtouch.inference import reference
from solidtouch.inference.engines.engine import make_engine
from solidtouch.inference.moves.table import BEFORE, held_out_tables, learn_table, load_table, lookup, save_table
from solidtouch.inference.reference import BORDERS
from solidtouch.inference.trials.records import TapTable, plan_trials, tap_table, trial_uniforms
from solidtouch.models.errors import InputError
from solidtouch.models.grid import ClassGrid, tap_pool
from solidtouch.models.measurement.histogram import fit
from solidtouch.models.seeds import Purpose, derived_seed

L, M, N = 4, 2, 48
GRID = ClassGrid(1.5 * np.arange(L), "mm", None, (("a",), ("b",)))


@pytest.fixture(scope="module")
def table():
    """Taps of every class, of which those at place 2 tell objects apart best."""
    rng = np.random.default_rng(0)
    where, what = np.repeat(np.arange(L), N // L), np.tile(np.arange(M), N // M)
    log_likelihood = rng.normal(scale=0.5, size=(N, L, M))
    log_likelihood[np.arange(N), where] += 1.5
    log_likelihood[np.arange(N), :, what] += np.where(where == 2, 4.0, 0.2)[:, np.newaxis]
    return TapTable(log_likelihood, tap_pool(where, what, (L, M)), np.full((L, M), -np.log(L * M)))


@pytest.mark.parametrize("border", BORDERS)
def test_the_table_leads_to_where_objects_are_told_apart(table, border):
    learned = learn_table([table], GRID, border=border, trials=300)

    assert learned.target.tolist() == [2] * L
    assert (learned.loss[:, 2] == learned.loss.min(axis=1)).all()
    assert learned.trials.sum() == 300 * BEFORE * L


@pytest.mark.parametrize("loss", ["error", "log"])
@pytest.mark.parametrize("taps", [1, 2])
@pytest.mark.parametrize("border", ["uniform", "clamp"])
def test_losses_are_those_of_single_episodes(table, border, loss, taps):
    """By the reference equations, trial by trial, after the move and so many taps there."""
    trials, seed = 12, 3
    learned = learn_table([table], GRID, border=border, loss=loss, taps=taps, trials=trials, seed=seed)
    expected = [[[] for _ in range(L)] for _ in range(L)]
    own = derived_seed(seed, Purpose.TARGETS, 0)
    plan = plan_trials(table.pool, trials, own)
    for where, what, stream in zip(plan.where, plan.what, plan.stream, strict=True):
        uniforms = trial_uniforms(own, int(stream), BEFORE + taps)
        belief = np.exp(table.log_prior)
        for before in range(BEFORE):
            belief, _ = reference.update(belief, table.log_likelihood[table.pool.pick(where, what, uniforms[before])])
            here = reference.where_decision(belief, 0)
            for target in range(L):
                at = min(max(where + target - here, 0), L - 1)
                moved = reference.shift(belief, target - here, border)
                for more in range(taps):
                    tap = table.pool.pick(at, what, uniforms[BEFORE + more])
                    moved, _ = reference.update(moved, table.log_likelihood[tap])
                decided = reference.what_marginal(moved)
                value = float(decided.argmax() != what) if loss == "error" else -np.log(max(decided[what], 1e-6))
                expected[here][target].append(value)

    assert learned.trials.tolist() == [[len(values) for values in row] for row in expected]
    for here in range(L):
        for target in range(L):
            values = expected[here][target]
            if len(values) > 1:
                assert learned.loss[here, target] == pytest.approx(np.mean(values), abs=1e-9)
                error = np.std(values, ddof=1) / np.sqrt(len(values))
                assert learned.error[here, target] == pytest.approx(error, abs=1e-7)
            else:
                assert np.isnan(learned.error[here, target])


def test_an_estimate_that_never_occurs_takes_what_is_best_on_average(table):
    """The rest of the table says where; it stays there where all is the same."""
    never = table._replace(log_prior=np.where(np.arange(L)[:, np.newaxis] == 0, -np.inf, table.log_prior))
    alike = table._replace(log_likelihood=np.zeros((N, L, M)))

    assert learn_table([never], GRID, border="clamp", trials=200).target[0] == 2
    assert learn_table([alike], GRID, border="clamp", trials=50).target.tolist() == list(range(L))


def test_the_policy_goes_to_the_target_of_the_estimate(table, rng):
    learned = learn_table([table], GRID, trials=100)._replace(target=np.array([3, 3, 0, 2]))
    beliefs = rng.dirichlet(np.ones(L * M), size=(5, 6)).reshape(5, 6, L, M)
    here = beliefs.sum(axis=-1).argmax(axis=-1)
    moves = lookup(learned)(beliefs, np.zeros((5, 6)))

    assert (moves.shape, moves.dtype) == ((5, 6), np.int64)
    assert (here + moves).tolist() == learned.target[here].tolist()
    with pytest.raises(InputError, match="has 4 positions, the belief 5"):
        lookup(learned)(np.ones((5, M)) / 10, np.zeros(()))


def test_tables_are_kept_whole(table, tmp_path):
    """Every number, also those that are not there; never over an existing file."""
    learned = learn_table([table], GRID, trials=5)
    save_table(learned, tmp_path / "t.json")
    read = load_table(tmp_path / "t.json")

    assert np.isnan(learned.error).any()
    for name, value in learned._asdict().items():
        np.testing.assert_array_equal(getattr(read, name), value, err_msg=name)
    assert read.checked(GRID) is read
    with pytest.raises(InputError, match="already exists"):
        save_table(learned, tmp_path / "t.json")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text[:40], "not a table of targets"),
        (lambda text: text.replace("table of targets", "model"), "not a table of targets"),
        (lambda text: text.replace('"taps": 1', '"taps": 1, "more": 2'), "unknown key `more`"),
        (lambda text: text.replace('"where_value": [', '"where_value": [9, '), "its parts do not match 4 positions"),
        (lambda text: text.replace('"target": [', '"target": [7, '), "its parts do not match 5 positions"),
    ],
)
def test_other_files_are_refused(table, tmp_path, change, message):
    path = tmp_path / "t.json"
    save_table(learn_table([table], GRID, trials=5), path)
    path.write_text(change(path.read_text(encoding="utf-8")), encoding="utf-8")

    with pytest.raises(InputError, match=message):
        load_table(path)


def test_a_file_that_is_no_text_is_refused(table, tmp_path):
    path = tmp_path / "t.json"
    save_table(learn_table([table], GRID, trials=5), path)
    path.write_bytes(path.read_bytes().replace(b"error", b"\xff"))

    with pytest.raises(InputError, match=r"t\.json: not a table of targets"):
        load_table(path)


def test_a_file_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"none\.json: cannot read"):
        load_table(tmp_path / "none.json")


@pytest.mark.parametrize("sessions", [1, 3])
def test_no_tap_is_judged_by_a_model_that_it_trained(make_taps, sessions):
    """Sessions are left out in turn, or the halves of a single one; every tap is judged once."""
    taps = make_taps(sessions=sessions, repeats=4, L=3, M=4)
    asked = []

    def fitted(part, grid):
        asked.append(fit(part, grid, bins=9))
        return asked[-1]

    tables = held_out_tables(taps, taps.grid(), fitted)

    assert len(tables) == len(asked) == max(2, sessions)
    assert sum(len(table.log_likelihood) for table in tables) == len(taps)
    held_out = [taps.select(~np.isin(np.arange(len(taps)), _trained(model, taps))) for model in asked]
    for table, model, left in zip(tables, asked, held_out, strict=True):
        np.testing.assert_array_equal(table.log_likelihood, tap_table(model, left).log_likelihood)


def _trained(model, taps):
    return [i for i in range(len(taps)) if model.trained_with(taps.select(np.arange(len(taps)) == i))]


def test_a_learned_table_moves_an_episode(make_taps):
    """From recorded taps to a move on a rig."""
    taps = make_taps(sessions=2, repeats=4, L=3, M=4)
    model = fit(taps, taps.grid(), bins=9)
    learned = learn_table(held_out_tables(taps, model.grid, lambda t, g: fit(t, g, bins=9)), model.grid, trials=60)
    rig = ReplayRig(taps, model.grid, 0, 1, iter([0.4]))
    belief, _ = make_engine("numpy", model).update(model.log_prior, rig.tap())
    delta = int(lookup(learned)(np.exp(belief), np.asarray(0.0)))

    assert delta == learned.target[np.exp(belief).sum(axis=1).argmax()] - np.exp(belief).sum(axis=1).argmax()
    assert np.isfinite(learned.loss[learned.trials > 0]).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"loss": "cost"}, "loss must be one of error, log, got 'cost'"),
        ({"taps": 0}, "at least 1 tap after the move .* got 0"),
        ({"trials": 0}, "trials must be at least 1"),
    ],
)
def test_what_makes_no_sense_is_refused(table, change, message):
    with pytest.raises(InputError, match=message):
        learn_table([table], GRID, **change)
