"""The noise-free contact."""

from dataclasses import replace

import numpy as np
import pytest
from solidtouch.hardware.simulator.physics import (
    effective_radius_mm,
    peak_depth_mm,
    press_profile,
    taxel_indentation_mm,
)
from solidtouch.hardware.simulator.settings import ICUB_FINGERTIP, RigSettings, Taxel

PAPER = RigSettings()


def contact_half_width_mm(settings, diameter_mm, depth_mm):
    """Half the length of the contact patch along the finger, `sqrt(2 R_e D)` for the depth `D`."""
    return float(np.sqrt(2 * effective_radius_mm(settings, diameter_mm) * depth_mm))


def point_taxels(along_mm):
    """Taxels without extent on the middle line."""
    taxels = tuple(Taxel(-6.4 - s, 0.0, 0.0, 1.0) for s in along_mm)
    return replace(PAPER, receptive_field_mm=0.0, taxels=taxels)


def naive_indentation(settings, position, diameter, depth):
    """The same sum, node by node."""
    node, weight = np.polynomial.hermite.hermgauss(7)
    result = np.zeros(len(settings.taxels))
    for k, taxel in enumerate(settings.taxels):
        for a, wa in zip(node, weight, strict=True):
            for b, wb in zip(node, weight, strict=True):
                s = taxel.along_mm + np.sqrt(2) * settings.receptive_field_mm * a
                z = taxel.lateral_mm + np.sqrt(2) * settings.receptive_field_mm * b
                curvature = 2 / diameter + 1 / settings.axial_radius_mm
                overlap = depth - (s - position) ** 2 * curvature / 2 - z**2 / (2 * settings.lateral_radius_mm)
                result[k] += taxel.facing * wa * wb / np.pi * max(0.0, overlap)
    return result


@pytest.mark.parametrize("diameter", [4.0, 12.0])
def test_patch_ends_at_the_half_width_of_the_contact(diameter):
    """The foam is indented up to sqrt(2 R_e D) from the nearest point and not beyond."""
    half = contact_half_width_mm(PAPER, diameter, 1.5)
    settings = point_taxels([8 - half - 0.01, 8 - half + 0.01, 8 + half - 0.01, 8 + half + 0.01])
    indentation = taxel_indentation_mm(settings, np.array([8.0]), diameter, np.array([[1.5]]))

    assert half == pytest.approx(np.sqrt(2 * effective_radius_mm(PAPER, diameter) * 1.5))
    assert (indentation[0, 0] > 0).tolist() == [False, True, True, False]


def test_larger_rods_give_wider_patches():
    """Half-widths grow with the diameter, in falling steps: 2.4 to 4.1 mm at a depth of 1.5 mm."""
    widths = [contact_half_width_mm(PAPER, rod.diameter_mm, 1.5) for rod in PAPER.rods]

    assert (np.diff(widths) > 0).all()
    assert (np.diff(widths, 2) < 0).all()
    assert widths[0] == pytest.approx(2.4, abs=0.05)
    assert widths[-1] == pytest.approx(4.1, abs=0.05)


def test_no_depth_gives_no_indentation():
    """Taxels see exactly nothing where the finger does not touch."""
    indentation = taxel_indentation_mm(PAPER, np.array([3.0, 8.0]), 8.0, np.zeros((2, 4)))

    assert indentation.shape == (2, 4, 12)
    assert not indentation.any()


def test_indentation_agrees_with_a_sum_over_single_nodes():
    """Mirror images and the vectorised sum change nothing."""
    position, depth = np.array([2.2, 8.1, 13.0]), np.array([[0.3, 0.1], [1.5, 0.7], [0.0, 0.4]])
    fast = taxel_indentation_mm(PAPER, position, 6.0, depth)
    slow = [[naive_indentation(PAPER, x, 6.0, d) for d in row] for x, row in zip(position, depth, strict=True)]

    np.testing.assert_allclose(fast, slow, rtol=1e-12, atol=1e-15)


def test_deep_contact_has_the_closed_form_of_a_gaussian_mean():
    """Where the foam is indented everywhere, the mean of the parabola is that at the centre plus the variances."""
    x, D, sigma = 8.0, 500.0, PAPER.receptive_field_mm
    indentation = taxel_indentation_mm(PAPER, np.array([x]), 10.0, np.array([[D]]))[0, 0]
    along = np.array([taxel.along_mm for taxel in ICUB_FINGERTIP])
    across = np.array([taxel.lateral_mm for taxel in ICUB_FINGERTIP])
    facing = np.array([taxel.facing for taxel in ICUB_FINGERTIP])
    gap = ((along - x) ** 2 + sigma**2) / (2 * effective_radius_mm(PAPER, 10.0))
    gap += (across**2 + sigma**2) / (2 * PAPER.lateral_radius_mm)

    np.testing.assert_allclose(facing * (D - gap), indentation, rtol=1e-12)


def test_depth_is_greatest_at_the_best_position_and_fades_to_the_pedestal():
    """Contact is deep at 8 mm and shallow, but there, far away."""
    depth = peak_depth_mm(PAPER, np.array([8.0, 7.0, 9.0, -100.0]))

    assert depth[0] == PAPER.depth_mm
    assert depth[1] == depth[2] < depth[0]
    assert depth[3] == pytest.approx(PAPER.depth_mm * PAPER.depth_edge)


def test_the_finger_touches_for_half_of_the_tap():
    """The press is half a sine from .25 to .75 s; a shift of one sample moves it by one sample."""
    profile = press_profile(PAPER, np.array([0.0, -1.0]))
    time = np.arange(50) / 50

    assert profile.shape == (2, 50)
    assert ((time > 0.25) & (time < 0.75)).tolist() == (profile[0] > 0).tolist()
    assert profile.max() <= 1
    np.testing.assert_allclose(profile[0, :-1], profile[1, 1:], atol=1e-12)


def test_the_middle_row_sits_near_the_best_position():
    """The published layout, measured from the base of a 14.5 mm finger, ends at its tip."""
    along = sorted({round(taxel.along_mm, 3) for taxel in ICUB_FINGERTIP})

    assert along == [3.9, 6.1, 7.7, 12.3, 14.5]
