"""The page as a widget of notebooks; needs anywidget (extra `notebook`)."""

import anywidget
import traitlets

from .assets import script, style
from .saved import Episodes, encoded_episodes

_RENDER = """
export default {
  render({ model, el }) {
    const root = document.createElement("div");
    el.append(root);
    const player = createPlayer(root, { autoplay: true });
    player.load(JSON.parse(model.get("episodes")));
    return () => player.remove();
  },
};
"""


class EpisodeWidget(anywidget.AnyWidget):
    """Recorded episodes, played inside a notebook.

    Attributes:
        episodes: Their JSON, as the file holds it.
    """

    _esm = script() + _RENDER
    _css = style()
    episodes = traitlets.Unicode("").tag(sync=True)


def widget(episodes: Episodes) -> EpisodeWidget:
    """Widget that plays recorded episodes."""
    return EpisodeWidget(episodes=encoded_episodes(episodes).decode())
