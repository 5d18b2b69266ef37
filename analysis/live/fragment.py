"""Recorded episodes as part of a page without a server, and as such a page."""

import base64
import html
import itertools
import json

from .assets import page_file, script, style
from .saved import Episodes, encoded_episodes

_numbers = itertools.count(1)


def fragment(episodes: Episodes, picture: str = "") -> str:
    """HTML of recorded episodes with all that is needed to play them; it loads nothing and styles nothing else.

    Without JavaScript and in print there are the picture and a sentence for each tap.

    Args:
        episodes: What is shown.
        picture: The last step as SVG, from `picture.live_picture`.
    """
    name = f"st-player-{next(_numbers)}"
    image = base64.b64encode(picture.encode()).decode()
    drawn = f'<img alt="{_escaped(episodes.taps[-1].sentence)}" src="data:image/svg+xml;base64,{image}">'
    data = encoded_episodes(episodes).decode().replace("<", "\\u003c")
    return (
        f"<style>{style()}{_STATIC}</style>\n"
        f'<div class="st-episode"><div id="{name}"></div>\n'
        f'<div class="st-static">{drawn if picture else f"<p>{_escaped(episodes.header.heading)}</p>"}\n'
        f"<ul>\n{_sentences(episodes)}</ul></div>\n"
        f'<script type="application/json" id="{name}-data">{data}</script>\n'
        f'<script type="module">\n{_inline(script())}\n'
        f"const root = document.getElementById({json.dumps(name)});\n"
        "createPlayer(root).load(JSON.parse(document.getElementById(root.id + '-data').textContent));\n"
        "root.parentElement.classList.add('st-mounted');\n</script></div>\n"
    )


def whole_page(episodes: Episodes) -> str:
    """The same as a page of its own."""
    title = _escaped(f"solidtouch: {episodes.header.heading}")
    icon = base64.b64encode(page_file("icon.svg")[0]).decode()
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<title>{title}</title>\n<link rel="icon" href="data:image/svg+xml;base64,{icon}">\n'
        f"<style>{page_file('page.css')[0].decode()}</style>\n</head>\n<body>\n<main>\n{fragment(episodes)}</main>\n"
        "</body>\n</html>\n"
    )


_STATIC = """
.st-static img { max-width: 100%; background: #fff; }
@media screen { .st-mounted > .st-static { display: none; } }
@media print { .st-episode > .st-player { display: none; } }
"""


def _sentences(episodes: Episodes) -> str:
    """A list item for each tap and each end, in their order."""
    ends = {end.episode: end for end in episodes.ends}
    items, last = [], episodes.taps[-1]
    for tap, following in itertools.zip_longest(episodes.taps, episodes.taps[1:]):
        items.append(f"<li>{_escaped(tap.sentence)}</li>\n")
        done = tap is last or following.episode != tap.episode
        if done and tap.episode in ends:
            items.append(f"<li><strong>{_escaped(ends[tap.episode].sentence)}</strong></li>\n")
    return "".join(items)


def _inline(code: str) -> str:
    return code.replace("</script", "<\\/script")


def _escaped(text: str) -> str:
    return html.escape(text)
