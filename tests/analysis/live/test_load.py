"""Many taps for many viewers."""

import json
import logging
import subprocess
import sys
import time
from pathlib import Path

import event_viewer
import numpy as np
import pytest
from solidtouch.analysis.live.feed import EpisodeFeed, finish_data
from solidtouch.analysis.live.server import PageServer

RATE_HZ = 200


@pytest.mark.parametrize(
    ("seconds", "viewers"), [(1, 4), pytest.param(60, 10, marks=pytest.mark.slow)], ids=["second", "minute"]
)
def test_taps_of_a_fast_rig_reach_all_viewers_in_time(seen_episodes, seconds, viewers):
    """Taps of the paper's size, 200 a second: each viewer gets each of them once, and the rig keeps its pace.

    `pytest --log-cli-level=INFO` shows the times.
    """
    header, (own, *_), _ = seen_episodes(L=16, M=5, J=50, K=12, episodes=1, deadline=20)
    server = PageServer()
    words = [sys.executable, str(Path(event_viewer.__file__)), server.url, str(viewers)]
    watching = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    try:
        feed = EpisodeFeed(server, keep=False)
        feed.start(header)
        while len(server._positions) < viewers:
            time.sleep(0.01)
        sent, busy, began = [], [], time.monotonic()
        for number in range(seconds * RATE_HZ):
            time.sleep(max(0.0, began + number / RATE_HZ - time.monotonic()))
            sent.append(time.time())
            before = time.perf_counter()
            feed.tap(1 + number // len(own), own[number % len(own)])
            busy.append(time.perf_counter() - before)
        late = time.monotonic() - began - seconds
        server.publish_last(finish_data("done"))
        arrived = json.loads(watching.communicate(timeout=60)[0])
    finally:
        server.close()
        watching.kill()
        watching.communicate()
    delays = np.array([[at for _, at in own[1 : 1 + len(sent)]] for own in arrived]) - sent
    numbers = [[number for number, _ in own][: 1 + len(sent)] for own in arrived]
    quantiles = {f"delay_ms_{q}": round(1e3 * float(np.quantile(delays, q)), 1) for q in (0.5, 0.99, 1.0)}
    quantiles["busy_ms_0.99"] = round(1e3 * float(np.quantile(busy, 0.99)), 1)
    logging.getLogger(__name__).info("%d taps, %d viewers: %s", len(sent), viewers, quantiles)

    assert numbers == [list(range(1, 2 + len(sent)))] * viewers
    assert late < 0.5
    assert np.quantile(delays, 0.99) < 0.1
    assert np.quantile(busy, 0.9) < 1 / RATE_HZ
