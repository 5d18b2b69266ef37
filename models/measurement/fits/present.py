"""Generative models that observe only the samples that are there."""

from collections.abc import Callable
from typing import Any

import numpyro.distributions as dist
from numpyro.primitives import Messenger


def peeled(distribution: Any) -> Any:
    """Distribution without expansions and declarations of events."""
    while isinstance(distribution, dist.ExpandedDistribution | dist.Independent):
        distribution = distribution.base_dist
    return distribution


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
            each, event_dim = peeled(msg["fn"]).mask(self._present), msg["fn"].event_dim
            msg["fn"] = each.to_event(event_dim) if event_dim else each
