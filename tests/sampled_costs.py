"""Random trials of a strategy under a Bayes-risk problem, which estimate its exact cost."""

import numpy as np
from solidtouch.inference.bayes_risk.exact_cost import Course
from solidtouch.inference.bayes_risk.problem import Floats, RiskProblem
from solidtouch.inference.information import shifted
from solidtouch.inference.stopping.stopping import DECIDE, GIVE_UP, GO_ON


def sampled_costs(problem: RiskProblem, act: Course, trials: int, generator: np.random.Generator) -> Floats:
    """Cost of random trials of a strategy, shape (trials,); its mean estimates `expected_cost`."""
    (L, M, S), rows = problem.channel.shape, np.arange(trials)
    cell = generator.choice(L * M, size=trials, p=problem.prior.ravel())
    where, what = np.divmod(cell, M)
    cumulative = problem.channel.cumsum(axis=-1)
    belief = np.broadcast_to(problem.prior, (trials, L, M))
    cost = np.zeros(trials)
    for number in range(1, problem.most_taps + 1):
        drawn = generator.random(len(rows))[:, np.newaxis] * cumulative[where, what, -1:]
        symbol = (drawn >= cumulative[where, what]).sum(axis=1).clip(0, S - 1)
        joint = belief * np.moveaxis(problem.channel, -1, 0)[symbol]
        belief = joint / joint.sum(axis=(1, 2), keepdims=True)
        cost[rows] += problem.tap_cost
        moves, answer = act(number, belief, generator.random(len(rows)))
        if number == problem.most_taps:
            answer = np.where(answer == GO_ON, DECIDE, answer)
        for said, losses in ((DECIDE, problem.loss[:M]), (GIVE_UP, problem.loss[M:])):
            at = answer == said
            if at.any():
                chosen = (belief[at].sum(axis=1) @ losses.T).argmin(axis=1)
                cost[rows[at]] += losses[chosen, what[at]]
        on = answer == GO_ON
        rows, where, what, moves = rows[on], where[on], what[on], np.asarray(moves)[on]
        reached = np.clip(where + moves, 0, L - 1)
        cost[rows] += problem.class_cost * np.abs(reached - where)
        where, belief = reached, shifted(belief[on], moves[:, np.newaxis], "clamp")[:, 0]
        if not len(rows):
            break
    return cost
