"""Generative models that observe only the samples that are there, or count them as often as they weigh."""

from collections.abc import Callable
from typing import Any

import numpyro.distributions as dist
from numpyro.primitives import Messenger


def layers(distribution: Any) -> list[Any]:
    """A distribution with its expansions, declarations of events and masks, then what they are around, and so on."""
    around = dist.ExpandedDistribution | dist.Independent | dist.MaskedDistribution
    return [distribution, *layers(distribution.base_dist)] if isinstance(distribution, around) else [distribution]


def peeled(distribution: Any) -> Any:
    """Distribution without expansions, declarations of events and masks."""
    return layers(distribution)[-1]


def remade(distribution: Any, each: Any) -> Any:
    """Another distribution with the masks and events of a distribution, in place of what that is without them."""
    for part in layers(distribution):
        if isinstance(part, dist.MaskedDistribution):
            mask: Any = part._mask
            if not isinstance(mask, bool):
                mask = mask.reshape(mask.shape + (1,) * (part.event_dim - each.event_dim))
            each = each.mask(mask)
    beyond = distribution.event_dim - each.event_dim
    return each.to_event(beyond) if beyond else each


class Present(Messenger):
    """Handler that makes a generative model observe only the samples that are there.

    Args:
        story: Generative model; its samples are independent.
        site: Name of the observed site.
        present: Mask of the samples, in the order of the site's axes.
    """

    def __init__(self, story: Callable[..., Any], site: str, present: Any) -> None:
        self._site, self._present = site, present
        super().__init__(story)

    def process_message(self, msg: dict[str, Any]) -> None:
        """Masks the distribution of the samples."""
        if msg["type"] == "sample" and msg["name"] == self._site and msg["is_observed"]:
            msg["fn"] = remade(msg["fn"], peeled(msg["fn"]).mask(self._present))


class Weighted(Messenger):
    """Block in which each observed sample of a generative model counts as often as it weighs.

    Args:
        site: Name of the observed site.
        weight: In the order of the site's axes.
    """

    def __init__(self, site: str, weight: Any) -> None:
        self._site, self._weight = site, weight
        super().__init__()

    def process_message(self, msg: dict[str, Any]) -> None:
        """Scales the log densities of the samples."""
        if msg["type"] == "sample" and msg["name"] == self._site and msg["is_observed"]:
            msg["scale"] = self._weight
