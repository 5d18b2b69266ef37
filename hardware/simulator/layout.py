"""Positions and orientation of the taxels of the simulated fingertip.

The positions are those of the iCub fingertip board, second revision (layout table in
github.com/icub-tech-iit/electronics-boards-public, sensor-boards/ftx2), accurate to about 0.5 mm.
The finger of the paper is an earlier revision whose layout is not public.
"""

from typing import NamedTuple

_BASE_TO_ORIGIN_MM = 6.4  # the published axial origin lies behind the base of a 14.5 mm fingertip


class Taxel(NamedTuple):
    """One pressure-sensitive pad.

    Attributes:
        axial_mm: Published axial coordinate; falls towards the tip.
        outward_mm: Published coordinate along the tap.
        lateral_mm: Published coordinate across the finger.
        facing: Fraction of the contact pressure on the pad, from the tilt of its normal: 1 faces the object, 0 faces
            sideways and stays idle.
    """

    axial_mm: float
    outward_mm: float
    lateral_mm: float
    facing: float

    @property
    def along_mm(self) -> float:
        """Distance from the base of the fingertip towards the tip."""
        return -self.axial_mm - _BASE_TO_ORIGIN_MM


ICUB_FINGERTIP = (
    Taxel(-10.3, 2.2, -3.8, 0.5),
    Taxel(-10.3, 4.4, 0.0, 1.0),
    Taxel(-10.3, 2.2, 3.8, 0.5),
    Taxel(-12.5, -1.4, 4.4, 0.0),
    Taxel(-12.5, -1.4, -4.4, 0.0),
    Taxel(-14.1, 2.2, 3.8, 0.5),
    Taxel(-14.1, 4.4, 0.0, 1.0),
    Taxel(-14.1, 2.2, -3.8, 0.5),
    Taxel(-18.7, 1.6, -2.5, 0.47),
    Taxel(-18.7, 3.15, 0.0, 0.87),
    Taxel(-18.7, 1.6, 2.5, 0.47),
    Taxel(-20.9, 0.0, 0.0, 0.6),
)
"""The twelve pads; `facing` follows the board's normals, except at the tip, where it is set by hand."""
