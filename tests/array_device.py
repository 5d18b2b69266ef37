"""Where tests run what is written for GPUs: on one, if JAX finds any."""

import jax

PLATFORM = "gpu" if any(device.platform == "gpu" for device in jax.devices()) else "cpu"
ARRAYS = {"gpu": "gpu", "cpu": "xla-cpu"}[PLATFORM]
