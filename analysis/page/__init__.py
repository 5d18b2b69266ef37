"""Pages of studies: records of sections, tables and figures, shown as HTML and in a terminal.

Start at `page`, then `html` and `terminal`, the only modules that know jinja2 and rich; `numbers` writes numbers.
Figures of several studies are here, those of one study in its folder. No study is imported.
"""
