"""The documentation site and the man pages.

Start at `build.py`. It stages the Markdown of README and docs together with generated pages (commands, API, sources,
gallery) in build/pages, from which Sphinx makes build/site as `conf.py` says.
"""
