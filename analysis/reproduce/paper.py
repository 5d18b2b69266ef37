"""The paper's own numbers beside ours."""

import xarray as xr

from .headline import finite
from .record import PaperRow

_HEADLINES = (
    # quantity, curve, variable, the paper's number in mm, where it stands
    ("rod diameter error, passive, mean over positions, best", "passive", "what_error", 2.0, "Sec. 3.2, 3.3"),
    ("rod diameter error, active, best", "active", "what_error", 0.4, "Sec. 3.3"),
    ("position error, passive, mean over positions, best", "passive", "where_error", 0.2, "Sec. 3.2, 3.3"),
    ("position error, active, best", "active", "where_error", 0.01, "Sec. 3.3"),
    ("rod diameter error, passive, at the centre, largest thresholds", "centre", "what_error", 0.4, "Sec. 3.2"),
    ("position error, passive, at the centre, largest thresholds", "centre", "where_error", 0.1, "Sec. 3.2"),
)


def compare(curves: dict[str, xr.Dataset], centre: xr.Dataset) -> list[PaperRow]:
    """The numbers that the text of the paper gives, each beside ours at the largest threshold.

    Args:
        curves: Outcomes over theta by policy.
        centre: Passive outcomes over theta at the default fixation point.
    """
    curves = curves | {"centre": centre}
    rows: list[PaperRow] = []
    for quantity, curve, name, value, source in _HEADLINES:
        if curve not in curves:
            continue
        ours = curves[curve].sortby("theta").isel(theta=-1)
        rows.append(
            {
                "quantity": quantity,
                "paper": value,
                "ours": finite(ours[name]),
                "ours_low": finite(ours[f"{name}_low"]),
                "ours_high": finite(ours[f"{name}_high"]),
                "unit": "mm",
                "source": f"{source}; ours at threshold {float(ours['theta']):g}",
            }
        )
    return rows
