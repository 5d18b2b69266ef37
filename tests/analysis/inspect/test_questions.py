"""Which questions data of known origin can answer."""

import numpy as np
import pytest
from solidtouch.analysis.audit.detectable import detectable_factor
from solidtouch.analysis.inspect.page import ANSWERS, inspection_page, overview_lines
from solidtouch.analysis.inspect.questions import QUESTIONS, divided
from solidtouch.analysis.inspect.quick_fit import MOST_SAMPLES, quick_fit
from solidtouch.analysis.inspect.run import inspect_taps
from solidtouch.analysis.page.terminal import as_text
from solidtouch.analysis.stats.detection import (
    LEVEL,
    POWER,
    detectable_factor_of,
    half_width,
    wrong_decisions_for,
)
from solidtouch.hardware.simulator.session import simulate_session
from solidtouch.hardware.simulator.settings import preset
from solidtouch.models import storage
from solidtouch.models.io.load import load_taps
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.taps import TapSet, concatenate


def answers_of(taps, **cells):
    return {one.question: one for one in inspect_taps(taps, taps.grid(**cells)).answers}


def lines_of(inspection):
    """Lines of the answers in a terminal of 80 columns."""
    lines = [line.rstrip() for line in as_text(inspection_page(inspection, "a.nc"), 80).splitlines()]
    after = next(i for i, line in enumerate(lines) if line.startswith(("Warning: ", "No data-quality warnings.")))
    return [line for line in lines[lines.index(ANSWERS) : after] if line]


def told(taps, **cells):
    return {name: one.answer for name, one in answers_of(taps, **cells).items()}


def test_interleaved_classes_with_enough_taps_answer_all(make_taps):
    taps = make_taps(L=4, M=3, J=1, K=3, sessions=4, repeats=700)
    noise = np.random.default_rng(4).normal(0, 1.5, taps.taps.shape)
    hard = TapSet(taps.dataset.assign(taps=taps.dataset["taps"] + noise))

    assert told(hard) == dict.fromkeys(QUESTIONS, "yes"), answers_of(hard)


@pytest.mark.parametrize(
    ("changes", "question", "answer", "why"),
    [
        ({"sessions": 1}, "new sessions", "no", "One session; record every class again on another day."),
        ({"sessions": 2}, "new sessions", "partly", "2 sessions; record 4 or more"),
        ({"sessions": 5}, "new sessions", "yes", "5 sessions hold the same classes."),
        ({"repeats": 1}, "several taps", "no", "One tap per class and session; record 20 in each."),
        ({"repeats": 7}, "several taps", "partly", "7 taps per class and session are few; record 10."),
        ({"repeats": 1, "sessions": 3}, "moves", "partly", "Moves back repeat the one tap of a class"),
        ({"repeats": 3}, "moves", "partly", "Moves back repeat the 3 taps of a class"),
        ({"L": 1}, "moves", "no", "There is one position; record several."),
        ({"M": 1}, "moves", "no", "There is one object; record several."),
        ({"repeats": 1, "sessions": 3}, "beliefs", "no", "One tap per class is left to judge on"),
        ({"repeats": 3, "sessions": 2}, "single taps", "partly", "3 taps per class to train with are too few"),
        ({"repeats": 9, "sessions": 1}, "single taps", "partly", "48 taps to test with give ±0.1"),
        ({"repeats": 8, "sessions": 1}, "single taps", "partly", "4 taps per class to train with are too few"),
        ({"repeats": 1, "sessions": 1}, "single taps", "no", "Each class has one tap, none to test with"),
        ({"L": 1, "M": 1}, "single taps", "no", "There is one class; record a second object."),
        ({"L": 1, "repeats": 6}, "single taps", "partly", "24 taps to test with give ±0.19; record 100 or more"),
    ],
)
def test_what_is_missing_is_said_with_what_to_record(make_taps, changes, question, answer, why):
    taps = make_taps(**changes)
    found = answers_of(taps)[question]

    assert (found.answer, found.why[: len(why)]) == (answer, why)
    assert len(lines_of(inspect_taps(taps, taps.grid()))) <= 8


def test_classes_without_a_tap_hinder_moves(make_taps):
    taps = make_taps()
    hole = taps.select(~((taps.what == 1) & (taps.where == 0)))
    diagonal = taps.select(np.abs(taps.where / 1.5 - taps.what) < 1)

    assert answers_of(hole)["moves"].why == "1 of 12 classes lack taps in a session; fill all."
    assert answers_of(diagonal)["moves"].answer == "no"


def test_sessions_of_different_classes_say_nothing_of_new_ones(make_taps):
    taps = make_taps()

    assert answers_of(taps.select((taps.session == 0) == (taps.what < 2)))["new sessions"].answer == "no"


def in_blocks(make_taps, drift, **more):
    """Taps of one object after the other, with a level that drifts over them."""
    taps = make_taps(repeats=10, L=2, **more)
    ordered = taps.select(np.lexsort((taps.trial, taps.what, taps.session)))
    level = drift * ordered.what[:, np.newaxis, np.newaxis]
    noise = np.random.default_rng(2).normal(size=ordered.taps.shape)
    data = ordered.dataset.assign(taps=(ordered.dataset["taps"].dims, noise + level))
    return TapSet(data.assign_coords(trial=("tap", np.arange(len(ordered)))))


def test_drift_in_blocks_is_named_with_what_the_first_sample_infers(make_taps):
    drifting = answers_of(in_blocks(make_taps, 4.0))

    assert drifting["single taps"].answer == "partly"
    assert drifting["single taps"].why.startswith("In blocks, and the first sample alone infers 1.00 (chance 0.25")
    assert drifting["several taps"].why == "Taps share their drift; alternate objects."
    assert drifting["moves"].answer == "partly"


def test_samples_known_to_be_before_contact_acquit_blocks(make_taps):
    """The user's record says that a press begins after three samples; there, objects drift apart or do not."""
    record = Preprocessing(samples=6, rate_hz=50.0, trigger="press", pre_samples=3)
    drifting, still = (in_blocks(make_taps, drift, preprocessing=record) for drift in (4.0, 0.0))
    touched = still.taps + 4.0 * still.what[:, np.newaxis, np.newaxis] * (np.arange(6) >= 3)[:, np.newaxis]
    touched = TapSet(still.dataset.assign(taps=(still.dataset["taps"].dims, touched)))

    assert answers_of(drifting)["single taps"].why.startswith("Samples before contact alone infer 1.00")
    assert told(touched)["several taps"] != "no"
    assert "before contact" not in answers_of(touched)["single taps"].why


def test_offsets_that_tell_the_object_are_named(make_taps):
    taps = in_blocks(make_taps, 4.0)
    tared = taps.taps - taps.taps[:, :1]
    data = taps.dataset.assign(taps=(taps.dataset["taps"].dims, tared), offset=(("tap", "taxel"), taps.taps[:, 0]))

    assert "subtracted offsets infer 1.00" in answers_of(TapSet(data))["single taps"].why


@pytest.mark.parametrize(
    ("trial", "expected"),
    [
        ([0, 2, 4, 0, 2, 4, 1, 3, 5, 1, 3, 5], "alternate"),
        ([0, 1, 2, 0, 1, 2, 3, 4, 5, 3, 4, 5], "run on"),
        ([0, 1, 2, 0, 1, 2, 0, 1, 2, 0, 1, 2], ""),
        ([0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11], ""),
    ],
)
def test_sessions_divided_from_one_recording_show_in_trial_numbers(trial, expected):
    """Two classes with three taps each in two sessions; numbers of whole recordings may run on."""
    assert divided(np.repeat([0, 1], 6), np.array(trial)) == expected


def test_large_recordings_are_not_fitted(make_taps, monkeypatch):
    taps = make_taps(sessions=4, repeats=24)
    monkeypatch.setattr("solidtouch.analysis.inspect.quick_fit.MOST_SAMPLES", taps.samples.size - 1)
    small = answers_of(taps)

    assert small["beliefs"].why == "Too large for a quick estimate; see solidtouch audit."
    assert (small["single taps"].answer, small["several taps"].answer) == ("yes", "yes")
    assert MOST_SAMPLES > 1600 * 600 * 12


def test_recordings_on_disk_are_not_fitted(make_taps, monkeypatch, tmp_path):
    make_taps().save(tmp_path / "a.nc")
    monkeypatch.setattr(storage, "ON_DISK", 0)
    taps = load_taps(tmp_path / "a.nc")

    assert quick_fit(taps, taps.grid()) is None


def test_missing_samples_do_not_count(make_taps):
    taps = make_taps(sessions=2, repeats=20)
    holes = taps.taps.copy()
    holes[::2, :, 0] = np.nan
    part = TapSet(taps.dataset.assign(taps=(taps.dataset["taps"].dims, holes)).assign_attrs(missing="drop"))
    whole, found = quick_fit(taps, taps.grid()), quick_fit(part, part.grid())

    assert whole is not None
    assert found is not None
    assert found.whole.accuracy == pytest.approx(whole.whole.accuracy, abs=0.1)
    assert found.whole.accuracy > 2 * found.whole.chance


@pytest.mark.parametrize("samples", [slice(None), slice(1)])
def test_taps_without_any_known_sample_show_nothing(make_taps, samples):
    """In all of them, or at the first one of each."""
    taps = make_taps(sessions=2, repeats=20)
    holes = taps.taps.copy()
    holes[:, samples] = np.nan
    empty = TapSet(taps.dataset.assign(taps=(taps.dataset["taps"].dims, holes)).assign_attrs(missing="drop"))
    inspection = inspect_taps(empty, empty.grid())

    assert len(lines_of(inspection)) <= 8
    if samples == slice(None):
        assert ("values", "none is known") in list(overview_lines(inspection))
        assert {one.answer for one in inspection.answers if one.question in ("single taps", "beliefs")} == {"no"}


def test_the_closed_form_agrees_with_the_rule_of_audits():
    """Of gamma distributed factors with the moments of Poisson counts, and of the counts themselves."""
    rng = np.random.default_rng(3)
    for wrong in (3, 11.4, 40):
        counts = rng.poisson(wrong, 40_000) / wrong
        limit = np.quantile(counts, 1 - LEVEL / 2)
        factor = detectable_factor_of(wrong)

        assert factor == pytest.approx(detectable_factor(counts, LEVEL / 2), rel=0.1)
        assert (rng.poisson(wrong * factor, 40_000) / wrong > limit).mean() == pytest.approx(POWER, abs=0.08)
        assert wrong_decisions_for(factor) == pytest.approx(wrong)
    assert detectable_factor_of(0) == np.inf


@pytest.mark.parametrize(("taps", "p"), [(30, 0.5), (100, 0.9), (1000, 0.5)])
def test_the_half_width_covers_the_accuracy(taps, p):
    """In 95% of the sets of independent taps, around Wilson's centre."""
    hits = np.random.default_rng(6).binomial(taps, p, 20_000) / taps
    half = np.array([half_width(taps, hit) for hit in hits])
    shrunk = (hits + 1.96**2 / (2 * taps)) / (1 + 1.96**2 / taps)

    assert (abs(shrunk - p) <= half).mean() == pytest.approx(0.95, abs=0.025)


EXPECTED = {
    "barrett_ballcyl": (("partly", "no", "partly", "partly", "no"), "subtracted offsets infer"),
    "barrett_boxes": (("partly", "no", "yes", "partly", "no"), "subtracted offsets infer"),
    "braille_icub": (("partly", "partly", "no", "no", "partly"), "Trial numbers alternate as in one recording"),
    "eflesh_grid": (("yes", "partly", "partly", "yes", "no"), "5 taps per class and session are few"),
    "icub_grasp": (("partly", "partly", "partly", "no", "no"), "the first sample alone infers 0.92"),
}


@pytest.mark.parametrize("name", EXPECTED)
def test_recorded_data_are_judged_as_they_were_recorded(name, shared_data):
    taps = load_taps(shared_data / f"{name}.npz")
    inspection = inspect_taps(taps, taps.grid())
    expected, part = EXPECTED[name]

    assert tuple(one.answer for one in inspection.answers) == expected
    assert part in " ".join(one.why for one in inspection.answers)
    assert len(lines_of(inspection)) <= 8


@pytest.fixture(scope="module")
def paper():
    """Four sessions of the paper's rig, whose high-pass forgets drift."""
    return [simulate_session(preset("paper"), 4, session) for session in range(4)]


@pytest.mark.parametrize(
    ("sessions", "expected"),
    [
        (1, ("yes", "partly", "no", "yes", "partly")),
        (2, ("yes", "partly", "partly", "yes", "yes")),
        (4, ("yes", "partly", "yes", "yes", "yes")),
    ],
)
def test_the_paper_s_rig_is_judged_by_its_sessions(paper, sessions, expected):
    taps = concatenate(paper[:sessions])

    assert tuple(told(taps, where_cell="1mm").values()) == expected


def test_only_answers_about_single_taps_and_beliefs_take_two_lines(make_taps, paper):
    """All of 80 columns."""
    for taps in (make_taps(sessions=1), in_blocks(make_taps, 4.0), paper[0], paper[0].select(paper[0].trial % 3 > 0)):
        title, *lines = lines_of(inspect_taps(taps, taps.grid()))
        begins = [line[1:13].strip() for line in lines]

        assert title == ANSWERS
        assert [name for name in begins if name] == list(QUESTIONS)
        assert {begins[n - 1] for n, name in enumerate(begins) if not name} <= {"single taps", "beliefs"}
        assert max(map(len, lines)) <= 80
