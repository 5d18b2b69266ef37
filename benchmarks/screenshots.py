"""Pictures of the page of `perceive --view` at three taps, light and dark, narrow and wide.

python -m benchmarks.screenshots [--out build/screenshots] [--document docs/how-to/images]

Chromium with its driver and selenium take them. The second folder gets those that the documentation shows.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

from PIL import Image
from solidtouch.analysis.live.feed import serve_saved
from solidtouch.analysis.live.saved import Episodes, load_episodes

from .browser import ARTEFACTS, chromium, picture, resize

if TYPE_CHECKING:
    from selenium.webdriver import Chrome

COMMANDS = (
    "simulate --sessions 2 --out data",
    "fit data/session-0.nc data/session-1.nc --out model.nc",
    "perceive model.nc --seed 11 --engine filter --save-episode episode.json",
)
SIZES = {"wide": 1600, "narrow": 420}
SCHEMES = ("light", "dark")
TAPS = {"first": ("Home",), "second": ("Home", "ArrowRight"), "last": ("End",)}
SHOWN = ("page-last-light-wide", "page-second-dark-wide", "page-second-light-narrow", "page-last-dark-narrow")
_COLOURS, _SOON_S = 128, 10.0


def example() -> Episodes:
    """The episode of the pictures, made by `COMMANDS`."""
    with tempfile.TemporaryDirectory() as folder:
        for command in COMMANDS:
            words = [sys.executable, "-m", "solidtouch.cli", *command.split()]
            subprocess.run(words, cwd=folder, check=True, stdout=subprocess.DEVNULL)  # noqa: S603 - our own
        return load_episodes(Path(folder) / "episode.json")


def take(driver: "Chrome", url: str, taps: int, folder: Path) -> list[Path]:
    """All pictures of a page with saved episodes."""
    driver.get(url)
    _until(driver, f"player.taps.length === {taps} && player.playing")
    _press(driver, " ")
    paths = []
    for scheme in SCHEMES:
        for size, width in SIZES.items():
            resize(driver, width, 900, scheme)
            for tap, keys in TAPS.items():
                _press(driver, *keys)
                time.sleep(0.3)  # canvases follow the size of the page
                paths.append(folder / f"page-{tap}-{scheme}-{size}.png")
                picture(driver, paths[-1])
    return paths


def _press(driver: "Chrome", *keys: str) -> None:
    for key in keys:
        driver.execute_script("document.dispatchEvent(new KeyboardEvent('keydown', {key: arguments[0]}))", key)


def _until(driver: "Chrome", code: str) -> None:
    end = time.monotonic() + _SOON_S
    while not driver.execute_script(f"const {{ player }} = document.querySelector('.st-player'); return {code}"):
        if time.monotonic() > end:
            raise TimeoutError(f"The page does not show the episode: {code}.")
        time.sleep(0.02)


def main() -> None:
    """Reads the options and takes the pictures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=ARTEFACTS, help="folder of all pictures")
    parser.add_argument("--document", type=Path, help="folder of those that the documentation shows")
    options = parser.parse_args()
    episodes = example()
    server = serve_saved(episodes)
    try:
        with chromium() as driver:
            paths = take(driver, server.url, len(episodes.taps), options.out)
    finally:
        server.close()
    for path in paths:
        print(path)
        if options.document is not None and path.stem in SHOWN:
            Image.open(path).convert("RGB").quantize(_COLOURS).save(options.document / path.name, optimize=True)


if __name__ == "__main__":
    main()
