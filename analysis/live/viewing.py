"""The function `solidtouch.view`: episodes of a program as a page, in a browser or a notebook."""

import sys
import weakref
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from ...hardware.named_rigs import Truth
from ...inference.episode import Episode, EpisodeSetup, Step
from ...inference.novelty import Novelty, UnknownTest, can_tell
from ...models.errors import InputError
from ...models.extras import extra
from .ending import ending_of
from .feed import open_page, serve_saved
from .fragment import fragment
from .picture import live_picture
from .saved import Episodes, header_of, load_episodes, recorded
from .view import Seen

if TYPE_CHECKING:
    from .server import PageServer

_FIRST_S = 20.0  # for a browser to start


class EpisodeView:
    """A page that shows episodes, as long as this object and the program exist.

    Attributes:
        url: Its address on this machine.
        episodes: What it shows.
    """

    def __init__(self, episodes: Episodes, server: "PageServer") -> None:
        self.url, self.episodes = server.url, episodes
        self._server, self._end = server, weakref.finalize(self, server.close)

    def close(self) -> None:
        """Ends the server; open pages keep what they show."""
        self._end()

    def __repr__(self) -> str:
        return f"<EpisodeView of {len(self.episodes.taps)} taps at {self.url}>"

    def _repr_html_(self) -> str:
        return fragment(self.episodes)


def view(episode: Episode | Sequence[Episode] | Episodes | str | Path, *, browser: bool = True, port: int = 0) -> Any:
    """Page that plays an episode: the belief after each tap, the taxels, the path of the finger and the decision.

    In Jupyter the page is a widget, which needs `solidtouch[notebook]`. Elsewhere it opens in the browser; without a
    display, or with `browser=False`, open its address yourself.

    >>> import solidtouch as st
    >>> model = st.fit(st.simulate("paper", seed=4))
    >>> rig = st.SimulatedRig("paper", seed=4, session=1, position_mm=2.3, what=1)
    >>> page = st.view(st.perceive(rig, model, stop=0.95, move=st.fixation(7)), browser=False)
    >>> page.url.startswith("http://127.0.0.1:"), len(page.episodes.taps)
    (True, 7)
    >>> page.close()

    Args:
        episode: What `perceive` returned, several of these with the same model, or a file of
            `solidtouch perceive --save-episode`.
        browser: Whether to open the browser, and to wait until it has the page.
        port: Port of the page; 0 takes a free one.

    Returns:
        An `EpisodeView`, or a widget in Jupyter.

    Raises:
        InputError: The episode was not made by `perceive`, the file cannot be read, the port is taken, or anywidget is
            not installed.
    """
    episodes = _recorded(episode)
    if browser and _in_notebook():
        with extra("anywidget"):
            from .widget import widget  # noqa: PLC0415 - optional
        return widget(episodes)
    server = serve_saved(episodes, port)
    shown = EpisodeView(episodes, server)
    if browser and open_page(server.url):
        if not hasattr(sys, "ps1"):
            server.wait_until_served(_FIRST_S)
    elif browser:
        print(f"Open {server.url} in a browser.", file=sys.stderr)  # noqa: T201 - nobody would find the page
    return shown


def _recorded(episode: Episode | Sequence[Episode] | Episodes | str | Path) -> Episodes:
    if isinstance(episode, Episodes):
        return episode
    if isinstance(episode, str | Path):
        return load_episodes(episode)
    if not isinstance(episode, Sequence):
        raise InputError(f"view needs an episode of perceive, or a file of episodes; got {type(episode).__name__}.")
    return recorded_episodes([episode] if isinstance(episode, Episode) else episode)


def recorded_episodes(episodes: Sequence[Episode], heading: str = "", truths: Sequence[Truth] = ()) -> Episodes:
    """Episodes of `perceive` as records; of several, the classes and the threshold are those of the first.

    Args:
        episodes: What `perceive` returned.
        heading: Rig and engine.
        truths: True object and position of each, if they are known.

    Raises:
        InputError: There is none, or one was not made by `perceive`, or with other classes.
    """
    setups = [each.setup for each in episodes if isinstance(each, Episode) and each.setup is not None]
    if len(setups) < len(episodes):
        raise InputError("view needs an episode of perceive, or a file of episodes; this one has no setup.")
    if not setups:
        raise InputError("view needs at least one episode.")
    setup, grid = setups[0], setups[0].model.grid
    sizes = {each.samples.shape[1:] for each in episodes}
    if len(sizes) > 1 or any(grid.differences(each.model.grid) for each in setups):
        raise InputError("view needs episodes with the same classes and taxels.")
    header = header_of(
        heading or f"{grid.M} objects at {grid.L} positions",
        grid,
        setup.model.preprocessing,
        episodes[0].samples.shape[2],
        theta=setup.theta,
        rule=_rule(setup),
        fixation=setup.fixation,
        taxel_mm=setup.taxel_mm,
        reading_unit=setup.units,
    )
    taps = [list(_seen(*each, header.heading)) for each in zip(episodes, setups, strict=True)]
    known = truths or [Truth(None, None)] * len(taps)
    return recorded(header, taps, [ending_of(own[-1], truth) for own, truth in zip(taps, known, strict=True)])


def example(episode: Episode, heading: str, truth: Truth) -> str:
    """HTML of one episode as part of a page."""
    episodes = recorded_episodes([episode], heading, [truth])
    *_, last = _seen(episode, cast("EpisodeSetup", episode.setup), heading)
    return fragment(episodes, live_picture(last))


def _rule(setup: EpisodeSetup) -> str:
    """Name of the stopping rule where it is not the threshold."""
    return "" if setup.theta < 1 else "another rule"


def _seen(episode: Episode, setup: EpisodeSetup, heading: str) -> Iterator[Seen]:
    """Each tap of an episode."""
    last = episode.taps - 1
    test = UnknownTest(Novelty(setup.model)) if can_tell(setup.model) else None
    moves, arrived = [*episode.moves.tolist(), None], [0, *episode.realised.tolist()]
    for t, log_belief in enumerate(episode.log_beliefs):
        step = Step(
            t + 1,
            episode.samples[t],
            arrived[t],
            log_belief,
            log_belief,
            float(episode.log_evidence[t]),
            episode.what if t == last and episode.stopped else None,
            moves[t],
            gave_up=t == last and episode.gave_up,
            no_class_left=bool(np.isneginf(episode.log_evidence[t])),
        )
        if test is not None:
            test.add(step.tap, step.arrived)
        p = None if test is None else test.p
        yield Seen(step, setup.model.grid, setup.theta, setup.fixation, p, heading=heading, rule=_rule(setup))


def _in_notebook() -> bool:
    """Whether this program is the kernel of a notebook."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return shell is not None and hasattr(shell, "kernel")
