"""The HTML report."""

import re
from html.parser import HTMLParser

import pytest
from solidtouch.analysis.page.old import image_uri, write_report

SUMMARY = {
    "title": "Twelve data sets <of> rods & balls",
    "what_was_run": ["First paragraph.", "Second paragraph."],
    "command": "solidtouch reproduce --seed 7",
    "versions": {"solidtouch": "0.1.0", "numpy": "2.3.1"},
    "seed": 123456789,
    "options": {"pseudocount": 0.01, "thresholds": [0.1, 0.9995], "theta_x": None, "cells": True},
    "data": [{"name": "session-0.nc", "taps": 1600, "sessions": 1, "description": "simulated"}],
    "split": {"method": "parity", "description": "Odd taps test.", "warning": "One session only."},
    "grid": {"L": 16, "M": 1, "K": 12, "J": 50, "where": "0.5 … 15.5 mm", "what": "rods", "left_out": ["none"]},
    "warnings": ["Taxel 3 never moves."],
    "results": [
        {
            "policy": policy,
            "theta": theta,
            **{f"{name}{end}": 1 + step for name in ("what_error", "where_error", "taps") for end, step in
               (("", 0.0), ("_low", -0.111), ("_high", 0.122))},
            "stopped_fraction": 0.987,
            "clamped_fraction": 0.0123,
            "substituted_fraction": 0.0,
            "what_wrong": 0.456,
        }
        for policy in ("passive", "active")
        for theta in (0.1, 0.9995)
    ],
    "interval": "Brackets hold 95 % of the resampled means.",
    "units": {"what": "mm", "where": "mm"},
    "fixation": {"index": 7, "value": 7.5},
    "accuracy": [{"contacts": 5, "joint": 0.71, "joint_low": 0.69, "joint_high": 0.74, "where": 0.8, "what": 0.9}],
    "paper": [
        {"quantity": "rod, passive", "paper": 2, "ours": 1.4, "ours_low": 1.29, "ours_high": 1.52, "unit": "mm",
         "source": "section 3.3"}
    ],
    "crosscheck": {
        "passed": False,
        "rows": [
            {"quantity": "posterior", "routes": "numpy, numpyro", "largest": 3.6e-15, "allowed": 1e-10, "passed": False}
        ],
        "episodes": 20,
        "taps": 400,
        "differing_decisions": 0,
        "differing_moves": 3,
        "near_ties": 1,
    },
    "simulated": True,
    "skipped": ["Figure 5 was left out."],
    "elapsed_s": {"simulate": 3.21234},
}  # fmt: skip


class Page(HTMLParser):
    """Open tags, references and the text of a page."""

    VOID = ("meta", "img")

    def __init__(self, text):
        super().__init__()
        self.open, self.references, self.images, self.words = [], [], [], []
        self.feed(text)
        self.close()
        self.text = " ".join(" ".join(self.words).split())

    def handle_starttag(self, tag, attrs):
        if tag not in self.VOID:
            self.open.append(tag)
        self.references += [value for name, value in attrs if name in ("src", "href", "srcset", "data", "action")]
        self.images += [dict(attrs)] if tag == "img" else []

    def handle_endtag(self, tag):
        assert tag == self.open.pop()

    def handle_data(self, data):
        self.words.append(data)


@pytest.fixture
def pictures(tmp_path):
    """Two figures as files: a small drawing, and one that is smaller as pixels."""
    found = []
    for name, drawn, pixels in (("fig3", 300, 200), ("fig6", 5_000_000, 1000)):
        png, svg = tmp_path / f"{name}.png", tmp_path / f"{name}.svg"
        png.write_bytes(b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + (1400).to_bytes(4, "big") + b"\0" * pixels)
        svg.write_text("<svg>" + " " * drawn + "</svg>")
        found.append({"name": name, "title": f"Title {name}", "caption": f'Caption "{name}"', "png": png, "svg": svg})
    return found


def page(folder, summary, figures=()):
    path = write_report(folder, summary, figures)

    assert folder / "report.html" == path
    return Page(path.read_text(encoding="utf-8"))


def test_the_page_is_complete_and_well_formed(tmp_path, pictures):
    """Every element is closed, and every sentence and row of the summary is on the page."""
    report = page(tmp_path, SUMMARY, pictures)

    assert report.open == []
    for expected in (
        "Twelve data sets <of> rods & balls",
        "First paragraph.",
        "Second paragraph.",
        "solidtouch reproduce --seed 7",
        "These data are simulated.",
        "One session only.",
        "Taxel 3 never moves.",
        "Figure 5 was left out.",
        "session-0.nc 1600 1 simulated",
        "parity . Odd taps test.",
        "16 where classes (0.5 … 15.5 mm) times 1 what class (rods); 12 taxels, 50 samples per tap.",
        "where class 7 (counted from 0), 7.5 mm.",
        "Left out, without a training tap: “none”.",
        "rod, passive mm 2 1.400 [1.290, 1.520] section 3.3",
        "Brackets hold 95 % of the resampled means.",
        "0.1 1.000 [0.889, 1.122] 0.456 1.000 [0.889, 1.122] 1.000 [0.889, 1.122] 98.7 % 1.2 % 0 %",
        "0.9995 1.000 [0.889, 1.122]",
        "5 – 0.7100 [0.6900, 0.7400] 0.8 0.9",
        "differences exceed the limits (20 episodes of 400 taps each). Differing decisions: 0, differing moves: 3",
        "posterior numpy, numpyro 3.6e-15 1e-10 FAILED",
        "Seed 123456789.",
        "thresholds [0.1, 0.9995] theta_x – cells True",
        "numpy 2.3.1",
        "simulate 3.21",
        'Title fig3 (fig3). Caption "fig3"',
    ):
        assert expected in report.text
    assert report.text.count("98.7 % 1.2 % 0 % 0.9995") == 2


def test_the_page_needs_nothing_from_outside(tmp_path, pictures):
    """References are places on the page or data within it; there is no script."""
    report = page(tmp_path, SUMMARY, pictures)

    assert all(reference.startswith(("#", "data:image/")) for reference in report.references)
    text = (tmp_path / "report.html").read_text()
    assert not re.search(r"<script|<link|@import|url\(", text)
    assert "http" not in re.sub(r'"data:[^"]*"', "", text)


def test_links_lead_to_sections_that_are_there(tmp_path, pictures):
    """The list of sections names no section that was left out."""
    for summary in (SUMMARY, {}):
        report = page(tmp_path, summary, pictures)
        text = (tmp_path / "report.html").read_text()

        assert all(f'id="{link[1:]}"' in text for link in report.references if link.startswith("#"))


def test_pictures_carry_a_text_and_their_width(tmp_path, pictures):
    """Small drawings are embedded as drawings, large ones as pixels, both in the width they were made for."""
    small, large = page(tmp_path, SUMMARY, pictures).images

    assert small["src"].startswith("data:image/svg+xml;base64,")
    assert large["src"].startswith("data:image/png;base64,")
    assert small["alt"] == 'Title fig3. Caption "fig3"'
    assert "672" == small["width"] == large["width"]


def test_of_two_large_files_the_smaller_is_embedded(pictures):
    """A drawing above the limit still wins where its pixels would be larger."""
    small = pictures[0]

    assert image_uri(small["png"], small["svg"], 0).startswith("data:image/png")
    small["png"].write_bytes(b"\0" * 1000)
    assert image_uri(small["png"], small["svg"], 0).startswith("data:image/svg+xml")


@pytest.mark.parametrize("missing", [*SUMMARY, "everything"])
def test_missing_keys_leave_their_section_out(missing, tmp_path):
    """No key of the summary is needed for a page."""
    summary = {} if missing == "everything" else {key: SUMMARY[key] for key in SUMMARY if key != missing}

    report = page(tmp_path, summary)

    assert report.open == []
    assert ("These data are simulated." in report.text) == bool(summary.get("simulated"))


def test_missing_numbers_are_dashes(tmp_path):
    """Rows with gaps, None and NaN are printed as far as they go."""
    rows = [{"policy": "passive", "theta": 0.5, "what_error": float("nan"), "taps": 3.25, "taps_low": None}]

    assert "0.5 – – – 3.25 – – –" in page(tmp_path, {"results": rows, "units": {"what": "mm", "where": ""}}).text


def test_objects_without_size_have_one_error_column(tmp_path):
    """Where the what error is P(wrong) it is not printed a second time."""
    text = page(tmp_path, SUMMARY | {"units": {"what": "P(wrong)", "where": "mm"}}).text

    assert "belief threshold what (P(wrong)) where error (mm)" in text
    assert "0.456" not in text


def test_real_data_are_not_called_simulated(tmp_path):
    """The note on calibration belongs to simulated data only."""
    assert "simulated." not in page(tmp_path, {"simulated": False}).text
