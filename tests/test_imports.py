"""What the modules load and do when they are imported, seen one after the other in a process of its own."""

import json
import subprocess
import sys

import pytest

SEEN = """
import importlib, json, pkgutil, sys

def loaded():
    return sorted(name for name, module in sys.modules.items() if module is not None)

seen, sys.modules["sklearn"] = {}, None
from solidtouch.models.measurement.registry import KINDS, measurement_model
seen["registry"] = loaded()
for kind in KINDS:
    measurement_model(kind)
seen["models"] = loaded()
from solidtouch import TapClassifier
try:
    TapClassifier(bins=3)
except ImportError as error:
    seen["refused"] = str(error)
import solidtouch.analysis.page.page, solidtouch.analysis.reproduce.figures
seen["figures"] = loaded()
import jax
before = dict(jax.config.values)
for package in ("models", "hardware", "inference", "analysis", "cli"):
    root = importlib.import_module("solidtouch." + package)
    for module in pkgutil.walk_packages(root.__path__, root.__name__ + "."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
seen["all"] = loaded()
seen["set up"] = dict(jax.config.values) != before or jax.config.jax_enable_x64
print(json.dumps(seen))
"""


@pytest.fixture(scope="module")
def seen():
    """The modules that were there after each step, and what else was seen; scikit-learn cannot be imported."""
    done = subprocess.run([sys.executable, "-c", SEEN], capture_output=True, text=True, check=False, timeout=120)
    assert (done.returncode, done.stderr) == (0, "")
    return json.loads(done.stdout)


def test_names_of_models_load_no_numpy_and_models_no_jax(seen):
    assert "numpy" not in seen["registry"]
    assert "numpy" in seen["models"]
    assert not {"jax", "numpyro", "arviz"} & set(seen["models"])


def test_without_scikit_learn_only_its_use_is_refused(seen):
    assert seen["refused"] == "TapClassifier needs scikit-learn: pip install 'solidtouch[sklearn]'."


def test_figures_do_not_import_matplotlib(seen):
    """It is loaded when the first figure is drawn."""
    assert "solidtouch.analysis.reproduce.figures" in seen["figures"]
    assert "matplotlib" not in seen["figures"]


def test_imports_change_nothing(seen):
    """No module of the packages sets JAX up, imports pyplot, which would choose a backend, or needs scikit-learn."""
    assert "jax" not in seen["figures"], "the settings of JAX were first looked at here"
    assert "solidtouch.inference.classifier" in seen["all"]
    assert not seen["set up"]
    assert "matplotlib.pyplot" not in seen["all"]
