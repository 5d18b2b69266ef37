"""Live view of episodes: in a terminal, as a picture, on a page, in a file.

Start at `view` for the terminal, `saved` for the data format, `server` for the page. No decisions: the view shows what
an episode of `inference` reports. Studies may embed an episode.
"""
