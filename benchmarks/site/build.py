"""Makes the documentation site as static files: `python -m benchmarks.site.build` (`make docs`).

Notebooks run when they have changed; their outputs are kept in build/notebooks. `--without-notebooks` shows them
without outputs, which takes half a minute instead of minutes. A warning is an error: a link, anchor or page that is
missing.
"""

import os
import sys
from argparse import ArgumentParser
from pathlib import Path
from shutil import rmtree

from sphinx.cmd.build import build_main

from benchmarks.site.links import ROOT
from benchmarks.site.pages import staged

STAGED, CACHE, TREES, IPYTHON = "pages", "notebooks", "doctrees", "ipython"
SETTINGS = """\
c = get_config()
c.InlineBackend.figure_formats = {"svg"}
c.InlineBackend.rc = {"svg.fonttype": "none"}
"""
"""Of the kernels that run notebooks."""


def stage(folder: Path) -> None:
    """Writes all pages and files into a folder, those alone that changed, and removes what is none of them."""
    pages, files = staged(folder)
    texts = {folder / path: text.encode() for path, text in pages.items()}
    every = texts | {folder / path: file.read_bytes() for path, file in files.items()}
    for path, content in every.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists() or path.read_bytes() != content:
            path.write_bytes(content)
    for path in folder.rglob("*"):
        if path.is_file() and path not in every:
            path.unlink()


def build(out: Path, work: Path, *, notebooks: bool = True) -> int:
    """Makes the site and returns the exit code of Sphinx.

    Args:
        out: Folder for the site.
        work: Folder for what the next build uses again.
        notebooks: Whether notebooks run.
    """
    stage(work / STAGED)
    _set_kernels(work / IPYTHON)
    options = {
        "nb_execution_mode": "cache" if notebooks else "off",
        "nb_execution_cache_path": (work / CACHE).resolve(),
    }
    given = [word for name, value in options.items() for word in ("-D", f"{name}={value}")]
    trees = work / (TREES if notebooks else f"{TREES}-plain")
    words = ["-b", "html", "-q", "-W", "--keep-going", "-j", "auto", "-c", str(ROOT / "benchmarks" / "site")]
    code = build_main([*words, *given, "-d", str(trees), str(work / STAGED), str(out)])
    if code:
        rmtree(trees, ignore_errors=True)  # Sphinx warns of a page when it reads it, so the next build reads all again
    return code


def _set_kernels(folder: Path) -> None:
    """Makes kernels draw figures as SVG, and keep their files here instead of in the home folder."""
    (folder / "profile_default").mkdir(parents=True, exist_ok=True)
    (folder / "profile_default" / "ipython_kernel_config.py").write_text(SETTINGS, encoding="utf-8")
    os.environ["IPYTHONDIR"] = str(folder.resolve())


if __name__ == "__main__":
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("build/site"), help="folder for the site")
    parser.add_argument("--without-notebooks", action="store_true", help="do not run notebooks")
    options = parser.parse_args()
    code = build(options.out, Path("build"), notebooks=not options.without_notebooks)
    if code == 0:
        print(f"The site is in {options.out}; open {options.out / 'index.html'}")
    sys.exit(code)
