"""Parameters of the simulated rig.

Sizes of finger and rods, range and timing are the paper's (sec. 2.3). Other values are from public sources where
available (named below) and otherwise **tuned to reproduce the paper's headline errors**: depth envelope, gains, noise
and drift. Agreement with the paper is therefore calibration, not evidence for it.

Positions of taxels are those of the iCub fingertip board, second revision (layout table in
github.com/icub-tech-iit/electronics-boards-public, sensor-boards/ftx2), accurate to about 0.5 mm. The finger of the
paper is an earlier revision whose layout is not public.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...models.errors import InputError
from ...models.preprocessing import Preprocessing

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


_ROUNDING = 1e-6
_SETTLED = 4.0  # time constants after which 2% of a step remain


class Rod(NamedTuple):
    """A cylinder to tap.

    Attributes:
        name: Name of the rod.
        diameter_mm: Diameter of the rod.
    """

    name: str
    diameter_mm: float


PAPER_RODS = tuple(Rod(f"{d} mm rod", float(d)) for d in (4, 6, 8, 10, 12))


@dataclass(frozen=True)
class RigSettings:
    """Generative model of the rig; the defaults are the preset `paper`.

    Standard deviations marked "log" are those of the logarithm, that is, approximately relative.

    >>> settings = RigSettings(end_mm=8.0, cell_mm=2.0, position_spread_mm=2.0)
    >>> settings.where_classes, settings.preprocessing.samples
    (4, 50)

    Attributes:
        rods: The objects (paper: 4 to 12 mm steel cylinders).
        start_mm: Lower end of the range of positions.
        end_mm: Upper end of the range (paper: 16 mm).
        spacing_mm: Distance between successive taps of the data collection (paper: 0.05 mm).
        cell_mm: Width of a position class, and length of a step (paper: 1 mm).
        position_spread_mm: Width of the centred interval of a position class from which its taps come; `cell_mm`
            gives continuous positions as in the paper, 0 puts all taps of a class at its centre.
        rate_hz: Frames per second (paper: 50).
        tap_period_s: Time from tap to tap (paper: 1 s).
        contact_start_s: Start of contact within a tap.
        contact_duration_s: Duration of contact.
        depth_mm: Indentation at the best position; the foam of such fingertips is about 2 mm thick.
        depth_edge: Indentation far from the best position, as a fraction of `depth_mm`.
        depth_width_mm: Standard deviation of the Gaussian between the two.
        depth_centre_mm: The best position; the middle taxel row sits at 7.7 mm.
        axial_radius_mm: Curvature of the finger along its axis, nearly straight.
        lateral_radius_mm: Curvature across, half the finger's width of 13 mm (Schmitz et al. 2010).
        receptive_field_mm: Standard deviation of a taxel's Gaussian receptive field, from the pad and the foam.
        taxels: Positions and tilt of the pads (github.com/icub-tech-iit/electronics-boards-public, ftx2).
        gain_counts_per_mm: Counts per millimetre of mean indentation at light load; gives peaks of about 100 counts, as
            in published traces of this fingertip on Braille (github.com/event-driven-robotics).
        compression_mm: Mean indentation at which compression halves the signal.
        sensitivity_log_sd: Log spread between the taxels of one sensor, the same in all sessions.
        lag_s: Time constant of the foam's first-order viscous lag.
        rail_counts: Mean reading without load; 240 in iCub software, at the upper rail in published traces.
        rail_sd_counts: Its spread between taxels; taxels whose idle reading exceeds 255 have a dead zone.
        highpass_hz: Cut-off frequency of the high-pass filter over the whole stream; the paper gives no value.
        white_counts: White noise of each taxel.
        taxel_noise_counts: Autocorrelated noise of each taxel.
        common_noise_counts: Autocorrelated noise common to all taxels.
        noise_correlation: Correlation of successive samples of the last two, each an AR(1) process.
        walk_counts: Step of each taxel's random walk per sample (slow thermal drift).
        hold_samples: Frames that repeat one reading (sample and hold); 1 for none.
        tap_depth_log_sd: Log spread of the indentation between taps, common to all taxels.
        tap_time_samples: Spread of the moment of contact between taps, in samples.
        tap_position_mm: Spread of the position between taps (paper: about 50 µm accuracy).
        session_gain_log_sd: Log spread of the gain between sessions, common to all taxels.
        session_taxel_gain_log_sd: Log spread of each taxel's gain between sessions.
        mounting_x_mm: Spread of each rod's position between sessions, from remounting.
        mounting_y_mm: Spread of each rod's distance between sessions, added to the indentation.

    Raises:
        InputError: A value is out of range or sizes do not match.
    """

    rods: tuple[Rod, ...] = PAPER_RODS
    start_mm: float = 0.0
    end_mm: float = 16.0
    spacing_mm: float = 0.05
    cell_mm: float = 1.0
    position_spread_mm: float = 1.0
    rate_hz: float = 50.0
    tap_period_s: float = 1.0
    contact_start_s: float = 0.25
    contact_duration_s: float = 0.5
    depth_mm: float = 1.5
    depth_edge: float = 0.2
    depth_width_mm: float = 2.5
    depth_centre_mm: float = 8.0
    axial_radius_mm: float = 100.0
    lateral_radius_mm: float = 6.5
    receptive_field_mm: float = 1.4
    taxels: tuple[Taxel, ...] = ICUB_FINGERTIP
    gain_counts_per_mm: float = 200.0
    compression_mm: float = 2.0
    sensitivity_log_sd: float = 0.15
    lag_s: float = 0.06
    rail_counts: float = 252.0
    rail_sd_counts: float = 3.0
    highpass_hz: float = 0.1
    white_counts: float = 1.0
    taxel_noise_counts: float = 1.0
    common_noise_counts: float = 1.0
    noise_correlation: float = 0.9
    walk_counts: float = 0.005
    hold_samples: int = 1
    tap_depth_log_sd: float = 0.02
    tap_time_samples: float = 0.2
    tap_position_mm: float = 0.05
    session_gain_log_sd: float = 0.03
    session_taxel_gain_log_sd: float = 0.03
    mounting_x_mm: float = 0.05
    mounting_y_mm: float = 0.02

    def __post_init__(self) -> None:
        """Checks the values."""
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name not in _ANY_SIGN and isinstance(value, int | float) and not value >= 0:
                raise InputError(f"{field.name} must not be negative, got {value}.")
        for name in _POSITIVE:
            if not getattr(self, name) > 0:
                raise InputError(f"{name} must be positive, got {getattr(self, name)}.")
        _check_whole("positions (range / cell_mm)", (self.end_mm - self.start_mm) / self.cell_mm)
        _check_whole("taps (range / spacing_mm)", (self.end_mm - self.start_mm) / self.spacing_mm)
        _check_whole("samples per tap (rate_hz * tap_period_s)", self.rate_hz * self.tap_period_s)
        if self.position_spread_mm > self.cell_mm:
            raise InputError(f"position_spread_mm={self.position_spread_mm} exceeds cell_mm={self.cell_mm}.")
        if not self.noise_correlation < 1:
            raise InputError(f"noise_correlation must be below 1, got {self.noise_correlation}.")
        if not self.rods or not self.taxels or any(not rod.diameter_mm > 0 for rod in self.rods):
            raise InputError("A rig needs at least one taxel and one rod, and diameters must be positive.")

    @property
    def where_classes(self) -> int:
        """Number of positions, `L`."""
        return round((self.end_mm - self.start_mm) / self.cell_mm)

    @property
    def where_edges_mm(self) -> NDArray[np.float64]:
        """Edges of the position classes in mm, shape (L + 1,)."""
        return self.start_mm + self.cell_mm * np.arange(self.where_classes + 1, dtype=np.float64)

    @property
    def nominal_mm(self) -> NDArray[np.float64]:
        """Positions in mm of the taps of one object in the data collection, shape (taps,)."""
        taps = round((self.end_mm - self.start_mm) / self.spacing_mm)
        return self.spread(self.start_mm + self.spacing_mm * (np.arange(taps) + 0.5))

    @property
    def preprocessing(self) -> Preprocessing:
        """Preprocessing of the stream: high-pass filter, then one tap per clock period."""
        return Preprocessing(
            samples=round(self.rate_hz * self.tap_period_s),
            rate_hz=self.rate_hz,
            highpass_hz=self.highpass_hz,
            trigger="clock",
        )

    @property
    def settling_taps(self) -> int:
        """Number of taps after which the high-pass filter has settled (four time constants)."""
        if self.highpass_hz == 0:
            return 0
        return int(np.ceil(_SETTLED / (2 * np.pi * self.highpass_hz * self.tap_period_s)))

    def spread(self, position_mm: ArrayLike) -> NDArray[np.float64]:
        """Positions contracted towards the centre of their class to `position_spread_mm`; same shape."""
        position = np.asarray(position_mm, dtype=np.float64)
        if self.position_spread_mm == self.cell_mm:
            return position
        centre = self.start_mm + self.cell_mm * (self.where_index(position) + 0.5)
        return centre + (position - centre) * (self.position_spread_mm / self.cell_mm)

    def where_index(self, position_mm: ArrayLike) -> NDArray[np.intp]:
        """Position index of each position in mm, clipped to the range; same shape."""
        cells = (np.asarray(position_mm, dtype=np.float64) - self.start_mm) / self.cell_mm
        return np.clip(np.floor(cells + _ROUNDING), 0, self.where_classes - 1).astype(np.intp)

    def describe(self) -> str:
        """Differences from the preset `paper`, as a phrase."""
        default = RigSettings()
        changes = [
            f"{field.name}={getattr(self, field.name)}"
            for field in fields(self)
            if getattr(self, field.name) != getattr(default, field.name)
        ]
        return "paper settings" + (f" with {', '.join(changes)}" if changes else "")


def _check_whole(name: str, value: float) -> None:
    if round(value) < 1 or abs(value - round(value)) > _ROUNDING * value:
        raise InputError(f"The number of {name} must be an integer of at least 1, got {value:g}.")


_ANY_SIGN = ("start_mm", "end_mm", "depth_centre_mm")
_POSITIVE = (
    "spacing_mm",
    "cell_mm",
    "rate_hz",
    "tap_period_s",
    "contact_duration_s",
    "depth_width_mm",
    "axial_radius_mm",
    "lateral_radius_mm",
    "compression_mm",
    "hold_samples",
)


_NO_DRIFT = RigSettings(session_gain_log_sd=0.0, session_taxel_gain_log_sd=0.0, mounting_x_mm=0.0, mounting_y_mm=0.0)

PRESETS = {
    "paper": RigSettings(),
    "ideal": replace(
        _NO_DRIFT,
        white_counts=1.7,
        taxel_noise_counts=0.0,
        common_noise_counts=0.0,
        walk_counts=0.0,
        tap_depth_log_sd=0.0,
        tap_time_samples=0.0,
        tap_position_mm=0.0,
    ),
    "broken": RigSettings(common_noise_counts=6.0),
    "hold2": RigSettings(hold_samples=2),
    "nodrift": _NO_DRIFT,
}
"""Settings by name: the paper's rig; without nuisances; with strong common noise; with every second frame repeated;
with identical sessions."""


def settings_of(rig: RigSettings | str) -> RigSettings:
    """Settings of a rig, or those of the preset of this name.

    Raises:
        InputError: It is neither.
    """
    if isinstance(rig, RigSettings):
        return rig
    if not isinstance(rig, str):
        raise InputError(f"A simulated rig is the name of a preset or RigSettings, got {type(rig).__name__}.")
    return preset(rig)


def preset(name: str, others: Sequence[str] = ()) -> RigSettings:
    """Settings of a preset.

    Args:
        name: A key of `PRESETS`.
        others: Further names that the caller accepts, for the message.

    Raises:
        InputError: The preset is unknown.
    """
    if name not in PRESETS:
        raise InputError(f"Unknown preset {name!r}; choose from {', '.join([*PRESETS, *others])}.")
    return PRESETS[name]
