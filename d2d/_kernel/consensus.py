"""The velocity that most Doppler velocities of a scan agree with."""

from d2d._kernel.compile import compiled, entry

_MIN_RATIO = 1e-3  # of the singular values of two directions, below which they count as one


@compiled
def velocity_of_two(direction, doppler, i, j):
    """The velocity (2,) of the sensor that explains the Doppler velocities of two targets.

    Where their directions are the same, it is the shortest that fits both best.
    """
    a0, a1 = direction[i, 0], direction[i, 1]
    b0, b1 = direction[j, 0], direction[j, 1]
    inner, cross = a0 * b0 + a1 * b1, a0 * b1 - a1 * b0
    if abs(cross) > _MIN_RATIO * (1.0 + abs(inner)):  # the singular values are sqrt(1 +- |inner|)
        return (
            (doppler[i] * b1 - doppler[j] * a1) / cross,
            (doppler[j] * a0 - doppler[i] * b0) / cross,
        )
    sign = 1.0 if inner >= 0.0 else -1.0
    common = (doppler[i] + sign * doppler[j]) / (2.0 * (1.0 + abs(inner)))
    return common * (a0 + sign * b0), common * (a1 + sign * b1)


@compiled
def agrees(direction, doppler, sigmas, k, velocity, gate):
    """Whether a target's Doppler velocity is within ``gate`` standard deviations of a velocity's.

    The error of the azimuth adds to that of the Doppler velocity by the derivative in it.
    """
    c, s = direction[k, 0], direction[k, 1]
    residual = doppler[k] - (c * velocity[0] + s * velocity[1])
    turned = sigmas[1, k] * (c * velocity[1] - s * velocity[0])
    variance = sigmas[0, k] * sigmas[0, k] + turned * turned
    return residual * residual < gate * gate * variance


@entry
def find_consensus(direction, doppler, sigmas, pairs, gate, agree):
    """Mark the targets (K,) that agree with the best of the velocities that pairs of them give.

    ``direction`` (K, 2) holds the derivatives of the Doppler velocities (K,) in the velocity, unit
    vectors; ``sigmas`` (2, K) the standard deviations of Doppler velocity and azimuth; ``pairs``
    (2, H) the targets of each pair.  Of velocities with equal support the first counts.
    """
    best, most = (0.0, 0.0), -1
    for h in range(pairs.shape[1]):
        velocity = velocity_of_two(direction, doppler, pairs[0, h], pairs[1, h])
        count = 0
        for k in range(doppler.shape[0]):
            count += agrees(direction, doppler, sigmas, k, velocity, gate)
        if count > most:
            best, most = velocity, count
    for k in range(doppler.shape[0]):
        agree[k] = agrees(direction, doppler, sigmas, k, best, gate)
