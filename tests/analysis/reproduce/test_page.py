"""The page of a run."""

import html
import re

import pytest
from matplotlib.figure import Figure
from solidtouch.analysis.experiment.crosscheck import CrossCheck, RouteDifference
from solidtouch.analysis.page import html as pages
from solidtouch.analysis.page.html import Image
from solidtouch.analysis.page.page import Picture
from solidtouch.analysis.reproduce.page import report_page

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
    "warnings": ["One session only.", "Taxel 3 never moves."],
    "results": [
        {
            "policy": policy,
            "theta": theta,
            **{f"{name}{end}": 1 + step for name in ("what_error", "where_error", "taps") for end, step in
               (("", 0.0), ("_low", -0.111), ("_high", 0.122))},
            "stopped_fraction": 0.987,
            "clamped_fraction": 0.0123,
            "substituted_fraction": 0.0,
            "no_class_left_fraction": 0.0,
            "what_wrong": 0.456,
        }
        for policy in ("passive", "active")
        for theta in (0.1, 0.9995)
    ],
    "interval": "Brackets hold 95% of the resampled means.",
    "units": {"what": "mm", "where": "mm"},
    "fixation": {"index": 7, "value": 7.5},
    "accuracy": [
        {"contacts": 5, "classes": None, "joint": 0.71, "joint_low": 0.69, "joint_high": 0.74, "where": 0.8,
         "what": 0.9}
    ],
    "paper": [
        {"quantity": "rod, passive", "curve": "passive", "error": "what_error", "paper": 2,
         "ours": 1.4, "ours_low": 1.29, "ours_high": 1.52, "unit": "mm",
         "source": "section 3.3"}
    ],
    "simulated": True,
    "skipped": ["Figure 5 was left out."],
    "elapsed_s": {"simulate": 3.21234},
}  # fmt: skip


SUMMARY["headline"] = {
    "answer": ["Active perception has a lower error.", "On fresh taps, too."],
    "theta": 0.9995,
    "still": "The finger hardly moved.",
    "few": "Too few test taps.",
    **{
        side: {"meaning": f"Meaning of {side}.", "rows": [row for row in SUMMARY["results"] if row["theta"] == theta]}
        for side, theta in (("stored", 0.9995), ("fresh", 0.9995), ("enough", 0.1))
    },
}
SUMMARY["differences"] = [
    {
        "theta": 0.1,
        **{f"{name}{end}": 0.2 for name in ("what_error", "where_error", "taps") for end in ("", "_low", "_high")},
    }
]
CHECK = CrossCheck((RouteDifference("posterior", "numpy, numpyro", 3.6e-15, 1e-16),), 20, 400, 8, 0, 3, 1, ())
PICTURE = Picture("fig3", "Title fig3", 'Caption "fig3"', Figure)


def page(summary, check=CHECK, drawn=(PICTURE,)):
    """The page as text."""
    images = {picture.name: Image("data:image/png;base64,AAAA", 672) for picture in drawn}
    text = pages.render_page(report_page(summary, check, drawn), images)
    text = re.sub(r"(?s)<(style|script)>.*?</\1>", "", text)
    return " ".join(html.unescape(re.sub(r"<[^>]*>", " ", text)).split())


def test_the_page_is_complete():
    """Every sentence and row of the summary is there."""
    report = page(SUMMARY)

    for expected in (
        "Twelve data sets <of> rods & balls",
        "First paragraph.",
        "Second paragraph.",
        "solidtouch reproduce --seed 7",
        "Active perception has a lower error. On fresh taps, too. The finger hardly moved. The data are simulated;",
        "paper, passive 2 – –",
        "One session only.",
        "Taxel 3 never moves.",
        "Figure 5 was left out.",
        "session-0.nc 1600 1 simulated",
        "parity . Odd taps test.",
        "16 position classes (0.5 … 15.5 mm) and 1 object class (rods); 12 taxels, 50 samples per tap.",
        "The fixation point is 7.5 mm (position class 7, counted from 0).",
        "Left out, because they have no training tap: “none”.",
        "rod, passive mm 2 1.40 [1.29, 1.52] section 3.3",
        "Brackets hold 95% of the resampled means.",
        "0.1 1.00 [0.89, 1.12] 0.456 1.00 [0.89, 1.12] 1.00 [0.89, 1.12] 98.7% 1.2% 0%",
        "0.9995 1.00 [0.89, 1.12]",
        "5 – 0.710 [0.690, 0.740] 0.8 0.9",
        "At threshold 0.9995, on stored taps",
        "passive 1.00 [0.89, 1.12]",
        "Read with care Too few test taps.",
        "0.1 active 1.00 [0.89, 1.12]",
        "Meaning of stored. Meaning of fresh. Meaning of enough. Brackets hold",
        "Differences are paired: passive and active trials have the same starts and random numbers.",
        "Passive minus active belief threshold object error (mm) position error (mm) reaction time (taps) 0.1 0.2 [0.2",
        "computed the same 20 episodes of 400 taps; differences exceed the limits.",
        "Differing decisions: 0, differing moves: 3",
        "posterior numpy, numpyro 3.6e-15 1e-16 FAILED",
        "Seed 123456789.",
        "thresholds [0.1, 0.9995] theta_x – cells True",
        "numpy 2.3.1",
        "simulate 3.21",
        'Title fig3 (fig3). Caption "fig3"',
    ):
        assert expected in report
    assert report.count("98.7% 1.2% 0% 0.9995") == 2


EMPTY = {
    "paper": (None, "Comparison with the paper"),
    "results": ([], "Clamped"),
    "accuracy": ([], "Accuracy against contacts"),
    "fixation": (None, "The fixation point is"),
    "differences": ([], "Passive minus active"),
    "data": ([], "session-0.nc"),
    "command": ("", "solidtouch reproduce"),
    "simulated": (False, "are simulated;"),
}


@pytest.mark.parametrize(("name", "value", "words"), [(name, *rest) for name, rest in EMPTY.items()], ids=EMPTY)
def test_what_is_empty_is_left_out(name, value, words):
    """With its heading; data that are not simulated are not called so."""
    assert words in page(SUMMARY)
    assert words not in page(SUMMARY | {name: value})


def test_without_cautions_and_figures_nothing_is_said_of_them():
    headline = SUMMARY["headline"] | {"few": None}
    assert "Read with care" not in page(SUMMARY | {"warnings": [], "skipped": [], "headline": headline})
    assert "Figures" not in page(SUMMARY, drawn=()).replace("Figure 5", "")


def test_missing_numbers_are_dashes():
    """Rows with gaps, None and NaN are printed as far as they go."""
    row = SUMMARY["results"][0] | {"theta": 0.5, "what_error": float("nan"), "what_wrong": None, "taps": 3.25}
    row |= dict.fromkeys(("where_error", "taps_low", "stopped_fraction", "clamped_fraction", "substituted_fraction"))

    assert "0.5 – – – 3.25 – – –" in page(SUMMARY | {"results": [row]})


def test_taps_that_leave_no_class_have_a_column():
    none_left = [row | {"no_class_left_fraction": 0.25} for row in SUMMARY["results"]]

    assert "no class left" not in page(SUMMARY).lower()
    assert "98.7% 1.2% 0% 25%" in page(SUMMARY | {"results": none_left})
    assert "No class left: fraction that ended undecided" in page(SUMMARY | {"results": none_left})


def test_objects_without_size_have_one_error_column():
    """Where the what error is P(wrong) it is not printed a second time."""
    text = page(SUMMARY | {"units": {"what": "P(wrong)", "where": "mm"}})

    assert "belief threshold object (P(wrong)) position error (mm)" in text
    assert "0.456" not in text


def test_engines_that_agree_are_said_to():
    assert "all differences are within the limits" in page(SUMMARY, CHECK._replace(rows=(), differing_moves=0))
