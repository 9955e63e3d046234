"""Settings for all tests."""

import gc
import os
from pathlib import Path

import matplotlib
import pytest
from hypothesis import settings

from tests.kernels import ForkedKernel

# Not in the environment: kernels inherit that, and draw into their pages.
matplotlib.use("Agg")

# Needs the built book and a browser: `make test-book` names it.
collect_ignore = ["book"]

# No deadline: the first example pays for compiling the kernel. The same examples on every run, so
# that a red test is red because of a change; explore with: pytest --hypothesis-profile=explore
settings.register_profile("reproducible", deadline=None, derandomize=True)
settings.register_profile("explore", deadline=None, max_examples=1000)
settings.load_profile("reproducible")


gc.disable()  # What is imported and collected stays to the end.


def pytest_configure(config: pytest.Config) -> None:
    """Let nbval fork the kernels of notebooks."""
    if config.getoption("nbval", False):
        from jupyter_client.provisioning import local_provisioner

        local_provisioner.launch_kernel = ForkedKernel


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.enable()


def folder_of(data_set: str) -> Path:
    """Folder of a data set; tests that ask for it are skipped where it is not."""
    variable = f"D2D_{data_set.upper()}"
    root = os.environ.get(variable)
    if not root:
        pytest.skip(f"set {variable} to the folder of the {data_set} data set")
    return Path(root)


@pytest.fixture(scope="session")
def radarscenes() -> Path:
    return folder_of("RadarScenes")


@pytest.fixture(scope="session")
def nuscenes() -> Path:
    return folder_of("nuScenes")
