"""Ctrl-C in a long call."""

import signal
import subprocess
import sys
import time

SCRIPT = """
import signal
import numpy as np
from d2d import CorruptedGaussian, PointSet, RegistrationCost, register, rigid
signal.signal(signal.SIGINT, signal.default_int_handler)
rng = np.random.default_rng(0)
means = rng.uniform(-30.0, 30.0, (60, 2))
fixed = PointSet(means, [0.04 * np.eye(2)] * 60)
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
    print("ready", flush=True)
    try:
        call(starts)
    except KeyboardInterrupt:
        assert np.array_equal(call(starts[:5]), expected)
        print("stopped", flush=True)
"""


def test_an_interrupted_batch_ends_and_the_next_call_is_right():
    """Breaks if Ctrl-C waits for the whole batch, which takes longer than the test would wait."""
    process = subprocess.Popen(
        [sys.executable, "-c", SCRIPT], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    try:
        for _ in range(4):
            assert process.stdout.readline() == "ready\n"
            time.sleep(0.2)
            process.send_signal(signal.SIGINT)
            assert process.stdout.readline() == "stopped\n"
        output, error = process.communicate(timeout=60)
    finally:
        process.kill()
    assert (output, error) == ("", "")


LARGE = """
import resource, signal, sys
import numpy as np
from d2d import PointSet, propagate_covariance, register
signal.signal(signal.SIGINT, signal.default_int_handler)
rng = np.random.default_rng(0)
means = rng.uniform(0.0, 450.0, (20_000, 2))
fixed = PointSet(means, 0.04 * np.eye(2))
moving = PointSet(means + 0.1 * rng.standard_normal(means.shape), fixed.covariances)
few = PointSet(means[:9], 0.04 * np.eye(2))
register(few, few)
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
estimate = register(fixed, moving)
print(bool(estimate.converged), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
wide = PointSet(means, 1e4 * np.eye(2))
print("ready", flush=True)
try:
    register(wide, wide)
except KeyboardInterrupt:
    print("stopped", flush=True)
"""


def test_a_large_problem_is_interrupted_and_bounded_in_memory():
    """Breaks if Ctrl-C waits for one large problem, or memory grows with the pairs: 2.9 GB."""
    process = subprocess.Popen(
        [sys.executable, "-c", LARGE], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    try:
        converged, kilobytes = process.stdout.readline().split()
        assert converged == "True"
        assert int(kilobytes) < 400_000
        assert process.stdout.readline() == "ready\n"
        time.sleep(0.5)
        begin = time.monotonic()
        process.send_signal(signal.SIGINT)
        assert process.stdout.readline() == "stopped\n"
        assert time.monotonic() - begin < 5.0  # 1 s on a quiet machine
        process.communicate(timeout=60)
    finally:
        process.kill()
