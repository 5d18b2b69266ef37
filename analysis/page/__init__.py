"""The HTML page of a study: its renderer, templates, figure style and wording that pages share.

Start at `page`, then `figure_style`. Figures of several studies are here, those of one study in its folder.
No numbers are computed here, and no study is imported.
"""
