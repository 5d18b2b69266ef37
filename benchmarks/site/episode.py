"""The moving picture of the README: the belief in object and position, tap by tap, in one episode.

`python -m benchmarks.site.episode` perceives the object of the README's first example and writes
docs/tutorials/images/episode.svg. The picture is moved by CSS alone, and stands still at the last tap where a reader
prefers less motion.
"""

from argparse import ArgumentParser
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from solidtouch.inference.episode import Step
from solidtouch.models.grid import ClassGrid
from solidtouch.models.storage import complete_file

import solidtouch as st

OUT = Path("docs/tutorials/images/episode.svg")
SECONDS, REST = 1.2, 3
"""For each tap, and how many times that for the last one."""
CELL, LEFT, TOP, BAR = 34, 92, 74, 110
_VIRIDIS = ("#440154", "#472c7a", "#3b518b", "#2c718e", "#21908d", "#27ad81", "#5cc863", "#aadc32", "#fde725")
_STYLE = """\
text, .still { fill: #57606a }
text { font: 13px "DejaVu Sans", "Segoe UI", Helvetica, Arial, sans-serif }
.name { text-anchor: end } .mid { text-anchor: middle } .title { font-size: 15px; font-weight: bold; fill: #24292f }
.bar { fill: #2c718e } .mark { stroke: #d1242f; stroke-width: 1.5; stroke-dasharray: 4 3 } .finger { fill: #d1242f }
.page { fill: #ffffff } .tap { opacity: 0 } .tap:last-of-type { opacity: 1 }
@media (prefers-color-scheme: dark) {
 text, .still { fill: #9198a1 } .title { fill: #f0f6fc } .page { fill: #0d1117 } .bar { fill: #5cc863 }
 .mark { stroke: #ff7b72 } .finger { fill: #ff7b72 }
}
"""


def episode_picture(
    steps: Sequence[Step], fingers: NDArray[np.float64], grid: ClassGrid, theta: float, fixation: int
) -> str:
    """An episode as a moving SVG.

    Args:
        steps: Its taps with the belief after each.
        fingers: True position of the finger at each, in position classes.
        grid: The classes.
        theta: Belief threshold, drawn at the bars of the objects.
        fixation: Fixation point, drawn below the positions.
    """
    width, height = LEFT + CELL * grid.L + BAR + 30, TOP + CELL * grid.M + 116
    said = "; ".join(_sentence(step, grid) for step in steps)
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" role="img" aria-labelledby="t d">',
        f'<title id="t">Belief in object and position, tap by tap</title><desc id="d">{said}.</desc>',
        f"<style>\n{_STYLE}{_motion(len(steps))}</style>",
        f'<rect class="page" width="{width}" height="{height}" rx="6"/>',
        *_frame(grid, theta, fixation),
    ]
    for number, (step, finger) in enumerate(zip(steps, fingers, strict=True)):
        lines += [f'<g class="tap" id="tap{number}">', *_tap(step, finger, grid), "</g>"]
    return "\n".join([*lines, "</svg>", ""])


def _motion(taps: int) -> str:
    """Each tap is shown for its share of a cycle; without motion the last one stays."""
    beats = taps - 1 + REST
    rules = []
    for number in range(taps):
        begin, end = 100 * number / beats, 100 * (number + 1) / beats if number < taps - 1 else 100
        shown = [f"{begin:.3f}% {{ opacity: 1 }}", f"{end - 0.001:.3f}% {{ opacity: 1 }}"]
        before = ["0% { opacity: 0 }", f"{begin - 0.001:.3f}% {{ opacity: 0 }}"] if number else []
        after = [f"{end:.3f}% {{ opacity: 0 }}", "100% { opacity: 0 }"] if number < taps - 1 else []
        rules.append(f"@keyframes k{number} {{ {' '.join([*before, *shown, *after])} }}")
        rules.append(f"#tap{number} {{ animation: k{number} {beats * SECONDS:.1f}s linear infinite }}")
    body = "\n".join(rules)
    return f"@media (prefers-reduced-motion: no-preference) {{\n{body}\n}}\n"


def _frame(grid: ClassGrid, theta: float, fixation: int) -> Iterator[str]:
    """What stands still: names, positions, threshold, fixation point."""
    for m, name in enumerate(grid.what_name):
        yield f'<text class="name" x="{LEFT - 8}" y="{TOP + CELL * (m + 0.5) + 5:.0f}">{name}</text>'
    below = TOP + CELL * grid.M
    for l, value in enumerate(grid.where_value):
        if l % 3 == 1:
            yield f'<text class="mid" x="{LEFT + CELL * (l + 0.5):.0f}" y="{below + 68}">{value:g}</text>'
    yield f'<text class="name" x="{LEFT - 8}" y="{below + 30}">belief</text>'
    yield f'<text class="name" x="{LEFT - 8}" y="{below + 68}">{grid.where_unit}</text>'
    point = LEFT + CELL * (fixation + 0.5)
    yield f'<path class="still" d="M{point - 6:.1f} {below + 86}h12l-6 -10z"/>'
    yield f'<text class="mid" x="{point:.1f}" y="{below + 102}">fixation point</text>'
    x = LEFT + CELL * grid.L + 10
    yield f'<text x="{x}" y="{TOP - 10}">belief</text>'
    yield f'<path class="mark" d="M{x + theta * BAR:.1f} {TOP}V{below}"/>'
    yield f'<text class="mid" x="{x + theta * BAR:.1f}" y="{below + 18}">{theta:g}</text>'


def _tap(step: Step, at: float, grid: ClassGrid) -> Iterator[str]:
    belief = np.exp(step.log_belief)
    yield f'<text class="title" x="{LEFT}" y="24">{_sentence(step, grid)}</text>'
    for l, m in np.ndindex(grid.L, grid.M):
        x, y = LEFT + CELL * l, TOP + CELL * m
        yield f'<rect x="{x}" y="{y}" width="{CELL - 1}" height="{CELL - 1}" fill="{_colour(belief[l, m])}"/>'
    bars: NDArray[np.float64] = belief.sum(axis=0)
    for m, value in enumerate(bars):
        x, y = LEFT + CELL * grid.L + 10, TOP + CELL * m
        yield f'<rect class="bar" x="{x}" y="{y + 6}" width="{BAR * value:.1f}" height="{CELL - 13}"/>'
    below = TOP + CELL * grid.M
    for l, value in enumerate(belief.sum(axis=1)):
        x, high = LEFT + CELL * l + 5, 42 * value
        yield f'<rect class="bar" x="{x}" y="{below + 8}" width="{CELL - 11}" height="{high:.1f}"/>'
    finger = LEFT + CELL * at
    yield f'<path class="finger" d="M{finger - 8:.1f} {TOP - 22}h16l-8 16z"/>'
    if step.arrived:
        start = finger - CELL * step.arrived
        yield f'<path class="mark" fill="none" d="M{start:.1f} {TOP - 16}H{finger:.1f}"/>'


def _sentence(step: Step, grid: ClassGrid) -> str:
    name, belief = grid.what_name[step.what], step.what_marginal.max()
    ends = f": decided, {name}" if step.decision is not None else f": {name}, belief {belief:.2f}"
    move = "" if not step.arrived else f", after a move by {step.arrived:+d}".replace("-", "−")
    return f"Tap {step.number}{move}{ends}"


def _colour(value: float) -> str:
    """Of viridis; the root makes small beliefs visible."""
    at = float(np.sqrt(min(1.0, max(0.0, value)))) * (len(_VIRIDIS) - 1)
    low = min(int(at), len(_VIRIDIS) - 2)
    parts = [[int(colour[i : i + 2], 16) for i in (1, 3, 5)] for colour in _VIRIDIS[low : low + 2]]
    mixed = [round(a + (at - low) * (b - a)) for a, b in zip(*parts, strict=True)]
    return "#{:02x}{:02x}{:02x}".format(*mixed)


def main() -> None:
    """Writes the picture."""
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=OUT, help="file to write")
    out = parser.parse_args().out
    theta, fixation = 0.95, 7
    train, _ = st.simulate("paper", sessions=2, seed=4)
    model = st.fit(train)
    rig = st.SimulatedRig("paper", seed=4, session=1, position_mm=2.3, what=1)
    seen = [(step, rig.position_mm) for step in st.steps(rig, model, theta, st.fixation(fixation))]
    taps, places = zip(*seen, strict=True)
    edges = model.grid.where_edges
    fingers = np.interp(places, edges, np.arange(len(edges)))
    out.parent.mkdir(parents=True, exist_ok=True)
    with complete_file(out, force=True) as temporary:
        temporary.write_text(episode_picture(taps, fingers, model.grid, theta, fixation), encoding="utf-8")
    print(f"{len(taps)} taps in {out}, {out.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
