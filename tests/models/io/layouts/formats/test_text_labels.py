"""Lines of text with a name before each number, as for Arduino's plotter of serial data."""

import pytest
from solidtouch.models.errors import InputError
from solidtouch.models.io.layouts.formats.contents import TextTable
from solidtouch.models.io.layouts.formats.text import TextContents

NUMBERS = [[n + 0.25, -n, 1e-3 * n] for n in range(50)]


def opened(folder, content, **how):
    path = folder / "t.txt"
    path.write_text(content)
    contents = TextContents(path, TextTable(**how))
    contents.without_cut = True
    return contents


def lines(between, colon=":", end="", names=("P1", "P2", "Fz N")):
    cells = ([f"{name}{colon}{number}" for name, number in zip(names, row, strict=True)] for row in NUMBERS)
    return "\n".join(between.join(each) + end for each in cells) + "\n"


@pytest.mark.parametrize("header", [True, False])
@pytest.mark.parametrize(
    ("content", "how"),
    [
        (lines(","), {}),
        (lines(", ", ": ", ","), {}),
        (lines("\t"), {}),
        (lines(" ", names=("P1", "P2", "FzN")), {}),
        (lines(";").replace(".", ","), {"decimal": ","}),
        (lines(";"), {"delimiter": ";"}),
        ("".join(f"14:02:11.{n:03} -> {line}" for n, line in enumerate(lines(",").splitlines(keepends=True))), {}),
        (lines(",") + "P1:7,P", {}),
    ],
)
def test_names_before_numbers_are_those_of_columns(tmp_path, content, how, header):
    contents = opened(tmp_path, content, header=header, **how)
    names = list(contents.variables)[-3:]

    assert names[:2] == ["P1", "P2"]
    assert contents.read([], names)[1].tolist() == NUMBERS
    assert contents.place(3) == "line 4"
    assert bool(contents.damage) == content.endswith("P")


def test_lines_with_other_names_are_refused(tmp_path):
    contents = opened(tmp_path, lines(",") + "P1:1,P3:2,Fz N:3\n")
    with pytest.raises(InputError, match="line 51, column P1: 'P1:1' is not a number"):
        contents.read([], ["P1"])


@pytest.mark.parametrize("content", ["f:1,f:2\n1,2\n3,4\n", "t,f:1\n1,2\n", "P:1,Q:2\nP:1,R:2\n", "a:b,c:d\na:b,c:d\n"])
def test_other_colons_stay_in_names_and_texts(tmp_path, content):
    assert list(opened(tmp_path, content).variables) == content.split("\n", 1)[0].split(",")
