"""Recorded episodes as part of a page without a server, and as such a page."""

import base64
from html import escape
from itertools import groupby

from .assets import page_file, script, style
from .saved import Episodes, encoded_episodes


def fragment(episodes: Episodes, picture: str = "") -> str:
    """HTML of recorded episodes with all that is needed to play them; it loads nothing and styles nothing else.

    Without JavaScript and in print there are the picture and a sentence for each tap.

    Args:
        episodes: What is shown.
        picture: The last step as SVG, from `picture.live_picture`.
    """
    head = f"<p>{escape(episodes.header.heading)}</p>"
    if picture:
        head = f'<img alt="{escape(episodes.taps[-1].sentence)}" src="{_uri(picture.encode())}">'
    data = encoded_episodes(episodes).decode().replace("<", "\\u003c")
    return (
        f"<style>{style()}{_STATIC}</style>\n"
        f'<div class="st-episode"><div></div>\n<div class="st-static">{head}\n'
        f"<ul>\n{_sentences(episodes)}</ul></div>\n"
        f'<script type="application/json">{data}</script>\n'
        f'<script type="module">\n{_inline(script())}\n{_MOUNT}</script></div>\n'
    )


def whole_page(episodes: Episodes) -> str:
    """The same as a page of its own."""
    title, icon = escape(f"solidtouch: {episodes.header.heading}"), _uri(page_file("icon.svg")[0])
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<title>{title}</title>\n<link rel="icon" href="{icon}">\n'
        f"<style>{page_file('page.css')[0].decode()}</style>\n</head>\n<body>\n<main>\n{fragment(episodes)}</main>\n"
        "</body>\n</html>\n"
    )


# Without ids: pages and notebooks may hold fragments of several programs, in which numbers would repeat.
_MOUNT = """\
for (const data of document.querySelectorAll(".st-episode:not(.st-mounted) > script[type='application/json']")) {
  createPlayer(data.parentElement.firstElementChild).load(JSON.parse(data.textContent));
  data.parentElement.classList.add("st-mounted");
}
"""
_STATIC = """
.st-static img { max-width: 100%; background: #fff; }
@media screen { .st-mounted > .st-static { display: none; } }
@media print { .st-episode > .st-player { display: none; } }
"""


def _sentences(episodes: Episodes) -> str:
    """A list item for each tap and each end, in their order."""
    ends = {end.episode: end for end in episodes.ends}
    items = []
    for number, taps in groupby(episodes.taps, lambda tap: tap.episode):
        items += [f"<li>{escape(tap.sentence)}</li>\n" for tap in taps]
        if number in ends:
            items.append(f"<li><strong>{escape(ends[number].sentence)}</strong></li>\n")
    return "".join(items)


def _inline(code: str) -> str:
    return code.replace("</script", "<\\/script")


def _uri(picture: bytes) -> str:
    return f"data:image/svg+xml;base64,{base64.b64encode(picture).decode()}"
