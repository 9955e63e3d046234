"""Ctrl-C in a long call, and the memory of a large one."""

import signal
import subprocess
import sys
import time

import pytest

BEGIN = """
import resource, signal
import numpy as np
from d2d import CorruptedGaussian, PointSet, RegistrationCost, register
signal.signal(signal.SIGINT, signal.default_int_handler)
rng = np.random.default_rng(0)
def interrupted(call, *long):
    print("ready", flush=True)
    try:
        call(*long)
    except KeyboardInterrupt:
        print("stopped", flush=True)
def memory():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
"""
BATCH = """
means = rng.uniform(-30.0, 30.0, (60, 2))
fixed = PointSet(means, 0.04 * np.eye(2))
moving = fixed.transformed([0.3, -0.2, 0.02])
cost = RegistrationCost(outlier=CorruptedGaussian(0.2, 100.0 * np.eye(2)))
starts = rng.normal(0.0, 0.3, (500_000, 3)) * [1.0, 1.0, 0.1]
for call in (
    lambda x: register(fixed, moving, cost, x).theta,
    lambda x: register(fixed, moving, cost, x, threads=2).theta,
    lambda x: cost.derivatives(x, fixed, moving)[2],
    lambda x: cost.target_densities(x, fixed, moving),
):
    expected = call(starts[:5])
    interrupted(call, starts)
    assert np.array_equal(call(starts[:5]), expected)
"""
LARGE = """
means = rng.uniform(0.0, 450.0, (20_000, 2))
fixed = PointSet(means, 0.04 * np.eye(2))
moving = PointSet(means + 0.1 * rng.standard_normal(means.shape), fixed.covariances)
few = PointSet(means[:9], 0.04 * np.eye(2))
register(few, few)
before = memory()
assert register(fixed, moving).converged
assert memory() - before < 400_000  # KB; lists for all pairs would take 2.9 GB
wide = PointSet(means, 1e4 * np.eye(2))
interrupted(register, wide, wide)
"""


@pytest.mark.parametrize(("script", "calls"), [(BATCH, 4), (LARGE, 1)], ids=["batch", "large"])
def test_an_interrupted_call_ends_soon(script, calls):
    """Breaks if Ctrl-C waits for the whole batch or problem, or the next call is wrong."""
    process = subprocess.Popen(
        [sys.executable, "-c", BEGIN + script],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    try:
        for _ in range(calls):
            assert process.stdout.readline() == "ready\n"
            time.sleep(0.3)
            begin = time.monotonic()
            process.send_signal(signal.SIGINT)
            assert process.stdout.readline() == "stopped\n"
            assert time.monotonic() - begin < 5.0  # 1 s on a quiet machine
        output, error = process.communicate(timeout=60)
    finally:
        process.kill()
    assert (output, error) == ("", "")
