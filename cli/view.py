"""`solidtouch view`: saved episodes on a page."""

import sys
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from ..models.errors import InputError
from .shared.interrupt import loading
from .shared.options import Force


def view(
    file: Annotated[
        Path, Argument(metavar="FILE.json", help="Episodes, from `perceive --save-episode`.", show_default=False)
    ],
    out: Annotated[
        Path | None, Option(metavar="FILE.html", help="Write the page to this file instead; it needs no server.")
    ] = None,
    port: Annotated[int | None, Option(min=1, max=65535, help="Port of the page; default: a free one.")] = None,
    no_browser: Annotated[bool, Option("--no-browser", help="Print the address of the page and open nothing.")] = False,
    force: Force = False,
) -> None:
    """Play saved episodes on a page in the browser, or write the page to a file."""
    if out is not None and (port is not None or no_browser):
        raise InputError("--out cannot be combined with --port or --no-browser.")
    with loading():
        from ..analysis.live.feed import open_page, serve_saved
        from ..analysis.live.fragment import whole_page
        from ..analysis.live.saved import load_episodes
        from ..models.storage import check_writable, complete_file
        from .shared.interrupt import ended_by_interrupt
        from .shared.showing import LineShow
        from .shared.watching import served_out

        if out is not None:
            if out.suffix.lower() not in {".html", ".htm"}:
                raise InputError(f"--out must name an .html file, got {out}.")
            check_writable(out, force)
        episodes = load_episodes(file)
    if out is not None:
        with complete_file(out, force) as temporary:
            temporary.write_text(whole_page(episodes), encoding="utf-8")
        print(f"Page: {out}")
        return
    server = serve_saved(episodes, port or 0)
    try:
        print(f"Page: {server.url}", flush=True)
        opened = not no_browser and open_page(server.url)
        if sys.stdout.isatty():
            print("Ctrl-C ends; open pages keep what they show.", flush=True)
            with ended_by_interrupt():
                server.wait()
        else:
            served_out(server, LineShow(), opened)
    finally:
        server.close()
