"""Models as C headers: what a compiler makes of them is the model, and the small C program decides as the reference."""

import json
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from solidtouch.inference import reference
from solidtouch.inference.engines.engine import NumpyEngine
from solidtouch.models.errors import InputError
from solidtouch.models.io.c_header import c_header, save_c_header
from solidtouch.models.io.export import Decisions, log_tables
from solidtouch.models.settings import likelihood_exponent

DECISIONS = Decisions("clamp", 0.9, 0.25, 1)
SOLID = Path(__file__).parents[3] / "docs" / "reference" / "conformance" / "solid.c"
COMPILERS = {
    "C": ("cc", "-x", "c", "-std=c99"),
    "C++": ("c++", "-x", "c++", "-std=c++11"),
}
STRICT = "-Wall", "-Wextra", "-Wpedantic", "-Werror"

PRINT = """
#include <stdio.h>
#include "model.h"

static void print(const void *numbers, size_t bytes)
{
    const SOLIDTOUCH_REAL *number = (const SOLIDTOUCH_REAL *)numbers;
    for (size_t i = 0; i < bytes / sizeof *number; i++) printf("%.17g ", (double)number[i]);
    puts("");
}

int main(void)
{
    printf("%d %d %d %d %d %d %d ", SOLIDTOUCH_FORMAT, SOLIDTOUCH_L, SOLIDTOUCH_M, SOLIDTOUCH_K, SOLIDTOUCH_J,
           SOLIDTOUCH_B, SOLIDTOUCH_FIXATION);
    printf("%d %s\\n", (int)sizeof(SOLIDTOUCH_REAL), SOLIDTOUCH_BORDER);
    printf("%.17g %.17g ", SOLIDTOUCH_EXPONENT, SOLIDTOUCH_SATURATION);
    printf("%.17g %.17g\\n", SOLIDTOUCH_THETA_W, SOLIDTOUCH_THETA_X);
    print(solidtouch_edges, sizeof solidtouch_edges);
    print(solidtouch_log_prob, sizeof solidtouch_log_prob);
    print(solidtouch_log_prior, sizeof solidtouch_log_prior);
    print(solidtouch_where_value, sizeof solidtouch_where_value);
    for (int m = 0; m < SOLIDTOUCH_M; m++) puts(solidtouch_what_name[m]);
    return 0;
}
"""


def compiled(folder, language, source, *options):
    """A program from a source text or file, which must give no warning."""
    compiler, *standard = COMPILERS[language]
    if shutil.which(compiler) is None:
        pytest.skip(f"there is no compiler {compiler}")
    path = source if isinstance(source, Path) else folder / "program.c"
    if path is not source:
        path.write_text(source, encoding="utf-8")
    program = folder / "program"
    command = [compiler, *standard, *STRICT, *options, f"-I{folder}", str(path), "-o", str(program), "-lm"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    return program


@pytest.mark.parametrize("single", [False, True], ids=["double", "single"])
@pytest.mark.parametrize("language", COMPILERS)
@pytest.mark.parametrize("value_range", ["global", "taxel"])
def test_a_compiled_program_holds_the_model_bit_for_bit(tmp_path, make_model, language, single, value_range):
    """Sizes, settings and every number of the tables, also minus infinity; no compiler warns."""
    model = replace(make_model(value_range=value_range, untrained=[(1, 2)], pseudocount=0.0), saturation=2.7)
    save_c_header(model, tmp_path / "model.h", DECISIONS, single)
    printed = subprocess.check_output([compiled(tmp_path, language, PRINT)], text=True).splitlines()
    kind = np.float32 if single else np.float64
    numbers = [np.array(line.split(), dtype=float) for line in printed[1:6]]
    edges = np.broadcast_to(model.edges, (2, 8))
    exact = [log_tables(model), model.log_prior, model.grid.where_value]

    assert printed[0] == f"1 3 4 2 5 7 1 {kind().itemsize} clamp"
    np.testing.assert_array_equal(numbers[0], [0.2, 2.7, 0.9, 0.25])
    np.testing.assert_allclose(numbers[1], edges.ravel(), rtol=2e-7 if single else 0, atol=0)
    for found, expected in zip(numbers[2:], exact, strict=True):
        np.testing.assert_array_equal(found, expected.astype(kind).ravel())
    assert np.isneginf(numbers[2]).any()
    assert printed[6:] == list(model.grid.what_name)


def test_names_and_comments_break_no_program(tmp_path, make_model):
    """Quotes, backslashes, ends of comments, trigraphs and other scripts come out as they went in, or in a comment."""
    names = ['6" rod', "back\\slash", "*/ int x; /*", "what??/now ??=", "10 µm … 球"]
    model = make_model(M=5)
    grid = replace(model.grid, what_members=tuple((name,) for name in names), where_unit="mm */ /* ??/")
    odd = replace(model, grid=grid, trained_on="a*/*/b/*/**/c\\\n*/ \u202e d.nc", version="")
    save_c_header(odd, tmp_path / "model.h", DECISIONS)
    for language in COMPILERS:
        printed = subprocess.check_output([compiled(tmp_path, language, PRINT)], encoding="utf-8")
        assert printed.split("\n", 6)[6] == "\n".join(names) + "\n"


def test_every_name_is_documented(make_model):
    """In docs/how-to/exported-models.md; sizes by their letters."""
    text = Path(__file__).parents[3].joinpath("docs/how-to/exported-models.md").read_text(encoding="utf-8")
    header = c_header(make_model(), DECISIONS)
    macros = [name for name in re.findall(r"#define SOLIDTOUCH_(\w+) ", header) if name not in "LMKJB"]
    arrays = re.findall(r"solidtouch_(\w+\[)", header)

    assert (len(macros), len(arrays)) == (8, 5)
    assert [name for name in macros if f"`SOLIDTOUCH_{name}`" not in text] == []
    assert [name for name in arrays if f"`solidtouch_{name}" not in text] == []


def test_a_header_says_where_it_comes_from(make_model):
    """Training taps, units, preprocessing, version and what the evidence is limited to."""
    model = replace(make_model(), trained_on="rods-*/.nc: the first trains", version="7.1", saturation=2.5)
    head = c_header(model, DECISIONS).split("*/", 1)[0]

    for said in ("rods-* /.nc: the first trains", "version 7.1", "unit 'mm'", "5 samples at unknown rate"):
        assert said in head
    assert "to the power min(1, 2.5 / n)" in head
    assert "Saturation: none." in c_header(make_model(), DECISIONS)
    assert "#define SOLIDTOUCH_SATURATION 0.0\n" in c_header(make_model(), DECISIONS)


FLOATS = st.floats(-1e6, 1e6, width=32)


@given(low=st.floats(-1e3, 1e3), width=st.floats(1e-3, 1e3), sample=FLOATS, which=st.integers(0, 7))
def test_single_precision_edges_leave_every_sample_its_bin(make_model, low, width, sample, which):
    """As they are rounded up, also for the samples nearest to an edge."""
    model = replace(make_model(), edges=np.linspace(low, low + 7 * width, 8))
    text = c_header(model, DECISIONS, single=True)
    row = text.split("solidtouch_edges", 1)[1].split("{\n{", 1)[1].split("}", 1)[0]
    edges = np.array([number.removesuffix("f") for number in row.split(", ")]).astype(np.float32)
    near = np.float32(model.edges[which])
    samples = np.array([sample, near, np.nextafter(near, np.float32(-9e9)), np.nextafter(near, np.float32(9e9))])

    np.testing.assert_array_equal(reference.bin_index(samples, edges), reference.bin_index(samples, model.edges))


def test_bins_too_narrow_for_single_precision_are_refused(make_model):
    model = replace(make_model(), edges=1e4 + 1e-5 * np.arange(8.0))

    assert "e" in c_header(model, DECISIONS)
    with pytest.raises(InputError, match="\\(--single\\) is too coarse for the bins of this model"):
        c_header(model, DECISIONS, single=True)


@pytest.mark.parametrize("border", reference.BORDERS)
@pytest.mark.parametrize("single", [False, True], ids=["double", "single"])
def test_the_small_c_program_perceives_as_the_reference(tmp_path, make_model, draw_samples, border, single):
    """Built with the header it gives the posteriors, decisions and moves of the reference, over taps and moves."""
    if not SOLID.exists():
        pytest.skip("docs/reference/conformance/solid.c is not there")
    model = make_model(value_range="taxel", untrained=[(0, 1)], power=0.3)
    decisions = Decisions(border, 0.6, 0.3, 1)
    save_c_header(model, tmp_path / "model.h", decisions, single)
    program = compiled(tmp_path, "C", SOLID, '-DMODEL_HEADER="model.h"')
    taps = draw_samples(model, 12).astype(np.float32)
    moves = [0, *(number % 5 - 2 for number in range(11))]
    lines = [
        json.dumps({"tap": number + 1, "move": move, "samples": tap.tolist()}) + "\n"
        for number, (move, tap) in enumerate(zip(moves, taps, strict=True))
    ]
    done = subprocess.run([program], input="".join(lines), capture_output=True, text=True, check=True)
    answers = [json.loads(line) for line in done.stdout.splitlines()]
    engine, log_belief = NumpyEngine(model, border), model.log_prior
    tolerance = 2e-5 if single else 1e-12
    decided = 0

    assert model.exponent == likelihood_exponent(0.3, 5, 2)
    assert [answer["tap"] for answer in answers] == list(range(1, 13))
    for number, (answer, tap, move) in enumerate(zip(answers, taps, moves, strict=True)):
        log_belief, log_evidence = engine.update(log_belief if number == 0 else engine.shift(log_belief, move), tap)
        belief = np.exp(log_belief)
        where = reference.where_decision(belief, 0.3)
        decision = reference.what_decision(belief, 0.6)
        decided += decision is not None
        np.testing.assert_allclose(answer["posterior"], belief, rtol=0, atol=tolerance)
        np.testing.assert_allclose(answer["log_evidence"], log_evidence, rtol=tolerance, atol=tolerance)
        assert answer["decisions"] == [decision]
        assert answer["move"] == (0 if where is None else 1 - where)
    assert decided > 0
