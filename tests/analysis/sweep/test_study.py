"""The study file, and the cells that it spans."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from solidtouch.analysis.sweep.cells import AXES, CellGrid
from solidtouch.analysis.sweep.data import Sources
from solidtouch.analysis.sweep.study import load_study, parse_study
from solidtouch.models.errors import InputError
from solidtouch.models.measurement.registry import NAMES

LEAST = """
name = "least"
trials = 10
thresholds = [0.9]
[[data]]
name = "paper"
preset = "paper"
"""

IN_GRID = {
    "an unknown key": ("pseudocuont = [1]", "grid: unknown key `pseudocuont`"),
    "a scalar for an axis": ("bins = 100", "grid.bins: must be a list of length 1 or more, got 100"),
    "an empty axis": ("seed = []", "grid.seed: must be a list of length 1 or more"),
    "no bins": ("bins = [0]", "grid.bins"),
    "a value twice": ("bins = [10, 10]", "grid.bins: 10 stands there twice"),
    "an unknown model": (
        'model = ["gauss"]',
        "grid.model: Unknown model 'gauss'; choose from histogram, .*session:NAME",
    ),
    "a model in two states": ('model = ["session:session"]', "grid.model: Unknown model 'session:session'"),
    "a model with a state and the border prior": (
        'model = ["profile", "session:profile"]\nborder = ["clamp", "prior"]',
        "grid.border: prior does not go with session:profile",
    ),
    "a power learned from no tap": ('power = ["learned:0"]', "grid.power: The power must be learned, or learned:"),
    "an unknown border": ('border = ["open"]', "grid.border"),
    "an unknown policy": ('policy = ["lazy"]', "grid.policy: it must be passive, active or a number"),
    "theta_X beyond 1": ("policy = [1.5]", "grid.policy"),
    "fixation is active": ('policy = ["fixation"]', "grid.policy: 'fixation' is written \"active\" here"),
    "theta_X is a number": ('policy = ["fixation:0.5"]', "with its theta_X as a number"),
    "a reach of 0": ('policy = ["step:0"]', "grid.policy: The number of a strategy must be an integer"),
    "a strategy that was left out": ('policy = ["two-taps"]', "grid.policy: it must be passive, active or a"),
    "the same with a number": ('policy = ["two-taps:8"]', "grid.policy: Unknown control strategy"),
    "an unknown strategy": ('policy = ["info:3"]', "grid.policy: Unknown control strategy"),
    "a power below 0": ("power = [-1]", "grid.power: The power must be J, JK, none or a positive"),
    "an infinite pseudocount": ("pseudocount = [inf]", "grid.pseudocount: the numbers must be finite"),
    "NaN as a pseudocount": ("pseudocount = [nan]", "grid.pseudocount"),
    "a negative fixation point": ("fixation = [-1]", "grid.fixation"),
}
WRONG = {name: (f"{LEAST}[grid]\n{text}", sentence) for name, (text, sentence) in IN_GRID.items()}
WRONG |= {
    "no TOML": ("name = ", "not TOML"),
    "no name": (LEAST.replace('"least"', '""'), "name: must be a text of length 1 or more"),
    "a threshold beyond 1": (LEAST.replace("0.9", "1.9"), "thresholds"),
    "a single resample": (LEAST.replace("trials", "resamples = 1\ntrials"), "resamples: it takes 2 or more"),
    "no trials": (LEAST.replace("10", "0"), "trials"),
    "neither preset nor files": (LEAST.replace('preset = "paper"', ""), r"data\[0\]: it needs either preset or files"),
    "preset and files": (f'{LEAST}files = ["a.nc"]', r"data\[0\]: it needs either preset or files"),
    "an unknown preset": (LEAST.replace('preset = "paper"', 'preset = "card"'), r"data\[0\].preset: .*card"),
    "seeds of files": (
        LEAST.replace('preset = "paper"', 'files = ["a.nc"]\nseeds = [1]'),
        r"data\[0\].seeds: it goes with preset only",
    ),
    "a split preset": (f'{LEAST}split = "parity"', r"data\[0\].split: it goes with files only"),
    "two data sets of one name": (f'{LEAST}[[data]]\nname = "paper"\npreset = "ideal"', "data: 'paper' stands there"),
}


@pytest.mark.parametrize(("text", "sentence"), WRONG.values(), ids=WRONG)
def test_what_cannot_be_used_is_named(text, sentence):
    with pytest.raises(InputError, match=sentence):
        parse_study(text)


def test_a_sentence_names_the_file(tmp_path):
    (tmp_path / "bad.toml").write_text("trials = 1", encoding="utf-8")

    with pytest.raises(InputError, match=r"bad\.toml: .*name"):
        load_study(tmp_path / "bad.toml")
    with pytest.raises(InputError, match=r"none\.toml: cannot read"):
        load_study(tmp_path / "none.toml")


@pytest.mark.parametrize("name", [*NAMES, *(f"session:{n}" for n in NAMES if n != "session")])
def test_every_model_of_the_catalogue_can_be_swept(name):
    assert parse_study(f'{LEAST}[grid]\nmodel = ["{name}"]\npower = ["learned", "learned:5", 0.1]').grid.model == (
        name,
    )


def grid_of(text: str, *names: str) -> CellGrid:
    return CellGrid.of(parse_study(LEAST + text), names or ("paper",))


def test_cells_are_numbered_with_the_last_axis_fastest():
    grid = grid_of('[grid]\nseed = [4, 5]\nbins = [8, 9]\npolicy = ["active"]', "a", "b")

    cells = [grid.cell(number) for number in range(len(grid))]

    assert [(cell.data, cell.bins, cell.seed) for cell in cells] == list(itertools.product("ab", (8, 9), (4, 5)))
    assert [cell.number for cell in cells] == list(range(8))


def test_the_policy_gives_the_threshold_for_a_move():
    grid = grid_of('[grid]\npolicy = ["passive", "active", 0.25]')

    assert [grid.cell(number).theta_x for number in range(3)] == [1.0, 0.0, 0.25]


def test_other_strategies_have_no_threshold_and_stand_for_all_fixation_points():
    """But not for all borders, which change the belief that they move by."""
    grid = grid_of(
        '[grid]\npolicy = ["random", "active", "info-what"]\nborder = ["uniform", "clamp"]\nfixation = [1, 2]'
    )

    cells = [grid.cell(int(number)) for number in grid.distinct]

    assert [(c.border, c.policy, c.fixation) for c in cells] == [
        (border, *rest)
        for border in ("uniform", "clamp")
        for rest in (("random", 1), ("active", 1), ("active", 2), ("info-what", 1))
    ]
    assert {cell.policy: cell.theta_x for cell in cells} == {"random": None, "active": 0.0, "info-what": None}


@given(
    lengths=st.tuples(*[st.integers(1, 3)] * len(AXES)),
    named=st.permutations(["passive", "random", 0.5]),
)
@pytest.mark.slow
def test_every_cell_has_one_distinct_cell_that_stands_for_it(lengths, named):
    axes = [tuple(range(n)) for n in lengths]
    policy = AXES.index("policy")
    axes[policy] = tuple(named[: lengths[policy]])
    grid = CellGrid(tuple(axes))

    places = [place for number in grid.distinct for place in grid.places(int(number))]

    assert sorted(places) == list(range(len(grid)))
    assert all(grid.places(int(number))[-1] == number for number in grid.distinct)


def test_passive_cells_stand_for_all_borders_and_fixation_points():
    grid = grid_of('[grid]\nborder = ["uniform", "clamp"]\nfixation = [1, 2, 3]\nseed = [0, 1]')

    cells = [grid.cell(int(number)) for number in grid.distinct]

    assert sum(cell.policy == "passive" for cell in cells) == 2
    assert sum(cell.policy == "active" for cell in cells) == 12


def test_a_split_into_folds_gives_a_data_set_for_each(make_study):
    path = make_study(data='split = "leave-one-session-out"')

    sources = Sources(load_study(path), path.parent)

    assert list(sources.keys) == ["rods, test session 0", "rods, test session 1"]
    first, second = map(sources.load, sources.keys)
    assert first != second
    assert np.unique(first.fold.test.session) == [0]
    assert np.unique(second.fold.test.session) == [1]


def test_the_key_of_files_follows_their_content(make_study, make_taps):
    path = make_study()
    before = Sources(load_study(path), path.parent).keys
    make_taps(seed=1).save(path.parent / "taps.nc", force=True)

    after = Sources(load_study(path), path.parent).keys

    assert before.keys() == after.keys()
    assert before["rods"] != after["rods"]


def test_a_file_that_cannot_be_split_is_named(make_study):
    path = make_study(data="train = [7]")

    with pytest.raises(InputError, match="data rods: --train: no session 7"):
        Sources(load_study(path), path.parent)


def test_data_sets_must_not_come_to_the_same_name():
    text = f'{LEAST}seeds = [1]\n[[data]]\nname = "paper-1"\npreset = "ideal"'

    with pytest.raises(InputError, match="two data sets have the same name"):
        Sources(parse_study(text), None)
