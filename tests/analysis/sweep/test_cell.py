"""One cell of a sweep, against the same computed apart."""

import numpy as np
import pytest
from solidtouch.analysis.stats.tallied import tally_means
from solidtouch.analysis.sweep import cell as sweep_cell
from solidtouch.analysis.sweep.cell import run_cell
from solidtouch.inference.information import tap_outcomes
from solidtouch.inference.moves.strategies import make_policy
from solidtouch.inference.moves.table import held_out_tables, learn_table
from solidtouch.inference.stopping.recorded import stops
from solidtouch.inference.stopping.stopping import what_above
from solidtouch.inference.trials.lockstep import play
from solidtouch.inference.trials.lockstep_tally import tally_policy
from solidtouch.inference.trials.records import plan_trials, tap_table
from solidtouch.inference.trials.run import run_trials
from solidtouch.inference.tuning.tempering import learn_power
from solidtouch.models.errors import InputError
from solidtouch.models.measurement.histogram import fit
from solidtouch.models.measurement.registry import fit_model
from solidtouch.models.settings import FitSettings, PlaySettings
from sweep_study import first_cell


def test_a_cell_holds_the_means_of_its_trials(make_study):
    path = make_study('policy = ["active"]\nfixation = [2]\npower = [0.3]', trials=50)
    cell, effort, data = first_cell(path)

    values = run_cell(cell, data, effort)

    model = fit(data.fold.train, data.grid, power=0.3)
    table = tap_table(model, model.usable(data.fold.test))
    seed = sweep_cell._trial_seed(cell)
    plan = plan_trials(table.pool, 50, seed, 2)
    trials = run_trials(table, plan, effort.thresholds, play=PlaySettings(theta_x=0.0, deadline=20), seed=seed)
    error = data.grid.where_error(trials.where, trials.true_where)
    np.testing.assert_allclose(values["taps"], trials.taps.mean(axis=0))
    np.testing.assert_allclose(values["where_error"], error.mean(axis=0))
    np.testing.assert_allclose(values["where_error_se"], error.std(axis=0, ddof=1) / np.sqrt(50), atol=1e-12)
    np.testing.assert_allclose(values["what_wrong"], (trials.what != plan.what[:, None]).mean(axis=0), atol=1e-12)
    np.testing.assert_allclose(values["belief"], trials.belief.mean(axis=0))
    assert values["trials"].tolist() == [50, 50]


@pytest.mark.parametrize("policy", ["random", "step:2", "info-what", "info-joint-per-mm", "info-where-per-s", "table"])
def test_a_cell_plays_any_strategy(make_study, policy):
    """Those that learn are given the training taps of the fold, and no others."""
    cell, effort, data = first_cell(make_study(f'policy = ["{policy}"]\nborder = ["clamp"]\nbins = [9]'))

    values = run_cell(cell, data, effort)

    model = fit(data.fold.train, data.grid, bins=9)
    outcomes = tap_outcomes(model.log_likelihood(model.usable(data.fold.train).taps))
    held_out = held_out_tables(data.fold.train, data.grid, lambda taps, grid: fit(taps, grid, bins=9))
    targets = learn_table(held_out, data.grid, border="clamp")
    strategy = make_policy(policy, data.grid, border="clamp", outcomes=outcomes, table=targets)
    table = tap_table(model, model.usable(data.fold.test))
    seed = sweep_cell._trial_seed(cell)
    plan = plan_trials(table.pool, 30, seed)
    record = play(table, plan, strategy, border="clamp", deadline=20, seed=seed)
    for h, threshold in enumerate(effort.thresholds):
        taps = stops(what_above(threshold), record).taps
        at = np.arange(30), taps - 1
        assert values["taps"][h] == pytest.approx(taps.mean())
        assert values["what_wrong"][h] == pytest.approx((record.what[at] != plan.what).mean(), abs=1e-12)
        assert values["where_error"][h] == pytest.approx(data.grid.where_error(record.where[at], record.at[at]).mean())


def test_active_cells_are_those_of_the_strategy_by_its_name(make_study):
    """Compiled or in step, the same trials."""
    cell, effort, data = first_cell(make_study('policy = ["active"]', trials=80))
    table, seed = sweep_cell._table(data, cell.fit_settings), sweep_cell._trial_seed(cell)
    counts = tally_policy(table, effort.thresholds, 80, make_policy("fixation", data.grid), deadline=20, seed=seed)

    values = run_cell(cell, data, effort)

    for name, mean in tally_means(counts, data.grid).items():
        np.testing.assert_allclose(values[name], mean, rtol=1e-9, err_msg=name)


@pytest.mark.parametrize("name", ["profile", "session:gaussian"])
def test_any_model_of_the_catalogue_is_swept(make_study, name):
    path = make_study(f'model = ["{name}"]\nbins = [9]\npolicy = ["passive"]')
    cell, effort, data = first_cell(path)

    values = run_cell(cell, data, effort)

    model = fit_model(name, data.fold.train, data.grid, FitSettings(bins=9)).model
    table = tap_table(model, model.usable(data.fold.test))
    seed = sweep_cell._trial_seed(cell)
    plan = plan_trials(table.pool, 30, seed, 1)
    trials = run_trials(table, plan, effort.thresholds, play=PlaySettings(theta_x=1.0, deadline=20), seed=seed)
    np.testing.assert_allclose(values["taps"], trials.taps.mean(axis=0))
    np.testing.assert_allclose(values["what_wrong"], (trials.what != plan.what[:, None]).mean(axis=0), atol=1e-12)


def test_a_power_is_learned_in_a_cell(make_study, make_taps):
    path = make_study('power = ["learned:2"]\nbins = [9]')
    make_taps(sessions=3, repeats=3).save(path.parent / "taps.nc", force=True)
    cell, _, data = first_cell(path)

    table = sweep_cell._table(data, cell.fit_settings)

    power = learn_power("histogram", data.fold.train, data.grid, FitSettings(bins=9), 2, 0).power
    model = fit(data.fold.train, data.grid, bins=9, power=power)
    np.testing.assert_array_equal(table.log_likelihood, model.log_likelihood(data.fold.test.taps))


def test_a_cell_whose_power_cannot_be_learned_is_refused(make_study):
    """One training session leaves none to be left out."""
    cell, effort, data = first_cell(make_study('power = ["learned"]'))

    with pytest.raises(InputError, match="at least two training sessions"):
        run_cell(cell, data, effort)


def test_one_trial_has_no_standard_error(make_study):
    cell, effort, data = first_cell(make_study(trials=1))

    values = run_cell(cell, data, effort)

    assert np.isnan(values["taps_se"]).all()
    assert np.isfinite(values["taps"]).all()


def test_data_sets_do_not_share_random_numbers_and_models_do(make_study):
    cell, _, _ = first_cell(make_study())

    assert sweep_cell._trial_seed(cell) != sweep_cell._trial_seed(cell._replace(data="others"))
    assert sweep_cell._trial_seed(cell) != sweep_cell._trial_seed(cell._replace(seed=1))
    assert sweep_cell._trial_seed(cell) == sweep_cell._trial_seed(cell._replace(pseudocount=7.0, number=9))
