"""Noise-free contact of a rounded fingertip with a rod: taxel indentation from position and depth.

A thin foam on a rigid core responds locally (Winkler bed), so the contact is the overlap of two rounded surfaces, as
in Hertz's geometry. The diameter of the rod only sets the width of that patch.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from .settings import RigSettings, Taxel

_NODES = 7  # Gauss-Hermite nodes per axis of a receptive field


def effective_radius_mm(settings: RigSettings, diameter_mm: float) -> float:
    """Effective radius `R_e` in mm along the finger, `1 / R_e = 1 / R_rod + 1 / R_finger`."""
    return 1.0 / (2.0 / diameter_mm + 1.0 / settings.axial_radius_mm)


def peak_depth_mm(settings: RigSettings, position_mm: NDArray[np.float64]) -> NDArray[np.float64]:
    """Deepest indentation in mm of a tap at each position, a Gaussian on a pedestal; same shape.

    The finger is rounded and tilted, and rods are mounted with their nearest points in line, so the depth depends on
    the position but not on the rod.
    """
    offset = (position_mm - settings.depth_centre_mm) / settings.depth_width_mm
    return settings.depth_mm * (settings.depth_edge + (1 - settings.depth_edge) * np.exp(-(offset**2) / 2))


def press_profile(settings: RigSettings, delay_samples: NDArray[np.float64]) -> NDArray[np.float64]:
    """Depth over time as a fraction of the deepest: half a sine during contact, else 0.

    Args:
        settings: Settings of the rig.
        delay_samples: Delay of each tap in samples, shape (n,).

    Returns:
        Values in [0, 1], shape (n, J).
    """
    time_s = (np.arange(settings.preprocessing.samples) + delay_samples[:, np.newaxis]) / settings.rate_hz
    phase = (time_s - settings.contact_start_s) / settings.contact_duration_s
    return np.where((phase > 0) & (phase < 1), np.sin(np.pi * phase), 0.0)


def taxel_indentation_mm(
    settings: RigSettings, position_mm: NDArray[np.float64], diameter_mm: float, depth_mm: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Mean indentation in the receptive field of each taxel, times its `facing`.

    At the distance `u` along and `z` across the finger from the nearest point, a depth `D` indents the foam by
    `max(0, D - u² / (2 R_e) - z² / (2 R_lateral))`. The Gaussian mean over a receptive field is a sum over 7 x 7
    Gauss-Hermite nodes.

    Args:
        settings: Settings of the rig.
        position_mm: Position of the rod along the finger, shape (n,).
        diameter_mm: Diameter of the rod.
        depth_mm: Depth of the nearest point over time, shape (n, J).

    Returns:
        Indentation in mm, shape (n, J, K).
    """
    along, across, weight = receptive_field(settings.receptive_field_mm)
    radius = effective_radius_mm(settings, diameter_mm)
    mirror_images: dict[tuple[float, float], NDArray[np.float64]] = {}
    indentation = np.zeros((*depth_mm.shape, len(settings.taxels)))
    for k, taxel in enumerate(settings.taxels):
        place = taxel.along_mm, abs(taxel.lateral_mm)
        if taxel.facing == 0:
            continue
        if place not in mirror_images:
            gap = (place[0] + along - position_mm[:, np.newaxis]) ** 2 / (2 * radius)
            gap += (place[1] + across) ** 2 / (2 * settings.lateral_radius_mm)
            mirror_images[place] = _mean_overlap(depth_mm, gap, weight)
        indentation[..., k] = taxel.facing * mirror_images[place]
    return indentation


def _mean_overlap(
    depth_mm: NDArray[np.float64], gap_mm: NDArray[np.float64], weight: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Weighted mean of `max(0, depth - gap)` over the nodes: (n, J), (n, Q), (Q,) -> (n, J)."""
    overlap = np.zeros_like(depth_mm)
    loaded = np.flatnonzero((depth_mm > 0).any(axis=0))
    excess = depth_mm[:, loaded, np.newaxis] - gap_mm[:, np.newaxis, :]
    overlap[:, loaded] = np.maximum(excess, 0.0, out=excess) @ weight
    return overlap


@lru_cache
def receptive_field(sd_mm: float) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Offsets along and across the finger, and weights, of the nodes of a receptive field; each of shape (49,)."""
    node, weight = np.polynomial.hermite.hermgauss(_NODES)
    along, across = np.meshgrid(np.sqrt(2) * sd_mm * node, np.sqrt(2) * sd_mm * node)
    return along.ravel(), across.ravel(), np.outer(weight, weight).ravel() / np.pi


def taxel_positions_mm(taxels: tuple[Taxel, ...]) -> NDArray[np.float64]:
    """Distance from the base, height and lateral offset of each taxel in mm, shape (K, 3)."""
    return np.array([(taxel.along_mm, taxel.outward_mm, taxel.lateral_mm) for taxel in taxels])
