"""Live output of `solidtouch perceive`: pictures in a terminal, lines in a file, JSON for programs."""

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from ...analysis.live.ending import Ending
    from ...analysis.live.view import Seen
    from ...inference.engines.latency import Latency


class Show(Protocol):
    """Shows the taps and decisions of episodes."""

    def note(self, text: str) -> None:
        """Shows a remark that is not a result."""
        ...

    def tap(self, seen: "Seen") -> None:
        """Shows a tap."""
        ...

    def end(self, episode: int, ending: "Ending") -> None:
        """Shows the end of an episode."""
        ...


class JsonShow:
    """Prints one JSON object per tap and decision on standard output, all else on standard error."""

    def __init__(self) -> None:
        self._episode = 1

    def note(self, text: str) -> None:
        """Prints a line on standard error."""
        print(text, file=sys.stderr, flush=True)

    def tap(self, seen: "Seen") -> None:
        """Prints a JSON object."""
        from ...analysis.live.view import record

        self._print({"episode": self._episode, **record(seen)})

    def end(self, episode: int, ending: "Ending") -> None:
        """Prints a JSON object."""
        from ...analysis.live.ending import end_record

        self._print(end_record(episode, ending))
        self._episode = episode + 1

    def _print(self, content: dict[str, Any]) -> None:
        print(json.dumps(content, ensure_ascii=False), flush=True)


class LineShow:
    """Prints one line per tap, for files and simple terminals."""

    def note(self, text: str) -> None:
        """Prints a line."""
        print(text, flush=True)

    def tap(self, seen: "Seen") -> None:
        """Prints a line."""
        from ...analysis.live.view import sentence

        print(sentence(seen), flush=True)

    def end(self, episode: int, ending: "Ending") -> None:
        """Prints a line."""
        from ...analysis.live.ending import said

        print(said(episode, ending), flush=True)


class LiveShow:
    """Shows a picture that is redrawn after each tap."""

    def __init__(self) -> None:
        from rich.console import Console
        from rich.live import Live

        self._console = Console(highlight=False)
        # The rig runs in a single loop, so the picture must not be refreshed by a thread.
        self._live = Live(console=self._console, auto_refresh=False, vertical_overflow="crop")

    def note(self, text: str) -> None:
        """Prints a line above the picture."""
        self._console.print(text, markup=False)

    def tap(self, seen: "Seen") -> None:
        """Redraws the picture."""
        from ...analysis.live.view import picture

        size = self._console.size
        self._live.update(picture(seen, size.width, max(2, size.height - 9)), refresh=True)
        if not self._live.is_started:
            self._live.start(refresh=True)

    def end(self, episode: int, ending: "Ending") -> None:
        """Keeps the last picture and prints a line below it."""
        from ...analysis.live.ending import said

        self.stop()
        self.note(said(episode, ending))

    def stop(self) -> None:
        """Releases the terminal."""
        self._live.stop()


@contextmanager
def show(as_json: bool) -> Iterator[Show]:
    """Display that suits standard output; the terminal is released at the end of the block."""
    if as_json:
        yield JsonShow()
    elif not sys.stdout.isatty():
        yield LineShow()
    else:
        live = LiveShow()
        try:
            yield live
        finally:
            live.stop()


def latency_sentence(latency: "Latency", warm_up_s: float) -> str:
    """Latency of the belief updates, as a sentence."""
    return (
        f"Update latency: median {latency.median_ms:.2f} ms, 99th percentile {latency.high_ms:.2f} ms over "
        f"{latency.taps} tap{'s' * (latency.taps != 1)}, after {warm_up_s:.1f} s of warm-up."
    )
