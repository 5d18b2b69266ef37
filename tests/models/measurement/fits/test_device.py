"""Devices of fits, on a processor that JAX takes for two devices."""

import subprocess
import sys

import jax
import pytest
from solidtouch.inference.fit import check_used
from solidtouch.models.errors import InputError
from solidtouch.models.measurement.fits.device import jax_device, on_device
from solidtouch.models.settings import FitSettings

STORY = """
import numpyro, numpyro.distributions as dist

def levels(where, what, taps=None, *, M, J, K):
    with numpyro.plate("M", M, dim=-2), numpyro.plate("K", K, dim=-1):
        level = numpyro.sample("level", dist.Normal(0.0, 3.0))
    with numpyro.plate("tap", len(where), dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("taxel", K, dim=-1):
        numpyro.sample("taps", dist.Normal(level[what][:, None], 1.0), obs=taps)
"""
TWO = """
import os
os.environ["XLA_FLAGS"] = "--xla_force_host_platform_device_count=2"
import jax
import solidtouch as st
from solidtouch.models.measurement.fits import device

taps, model = st.simulate("ideal", seed=1)[0].select(slice(0, None, 40)), "story.py:levels"
first = st.fit(taps, model, method="map")
second, made, whole = jax.devices("cpu")[1], [], jax.numpy.asarray
device.jax_device = lambda platform: second
jax.numpy.asarray = lambda *a, **k: made.append(whole(*a, **k)) or made[-1]
found = st.fit(taps, model, method="map", device="gpu")
where = {place for one in made if not isinstance(one, jax.core.Tracer) for place in one.devices()}
assert where == {second}, where
assert abs(found.parameters["level"] - first.parameters["level"]).max() < 1e-9
"""


def test_what_is_computed_already_there_stays_where_it_is():
    """No device is chosen, so no program is compiled again."""
    with on_device(jax.default_backend()):
        assert jax.config.jax_default_device is None


def test_without_a_gpu_a_fit_is_refused():
    if any(device.platform == "gpu" for device in jax.devices()):
        pytest.skip("there is a GPU here")
    with pytest.raises(InputError, match="--device gpu requires one"):
        jax_device("gpu")


def test_a_fast_fit_has_no_device():
    with pytest.raises(InputError, match=r"--device gpu\) is for functions and nuts"):
        check_used("gaussian", FitSettings(device="gpu"))
    check_used("gaussian", FitSettings(device="gpu", method="nuts"))


@pytest.mark.slow
def test_a_fit_on_another_device_is_the_same(tmp_path):
    (tmp_path / "story.py").write_text(STORY, encoding="utf-8")
    subprocess.run([sys.executable, "-c", TWO], check=True, cwd=tmp_path)
