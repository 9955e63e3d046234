"""A scalar measurement of each moving target, in addition to its position."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from d2d._checks import SCALE, Bounds, broadcast_batches, check_flag, check_shape
from d2d._frozen import Frozen
from d2d._kernel import layout
from d2d._types import Array

# Bounds within which the squares and products of a density's terms are finite.
_ANY, _SIGMA = Bounds(most=1e20), Bounds(above=0.0, least=1e-20, most=1e20)
_INPUT = Bounds(least=0.0, most=1e20)


@dataclass(frozen=True, eq=False)
class LinearMeasurement(Frozen):
    r"""A scalar measured of each moving target, which is linear in the motion.

    It is
    :math:`z_k \sim \mathcal N(h_k^{\mathsf T} \xi, \sigma_k^2 + q_k^2 (s_k^{\mathsf T} \xi)^2)`
    with :math:`\xi` the motion theta or its twist, `d2d.rigid.logarithm`.  Its density multiplies
    the target's inlier density only.  The variance may grow: :math:`s_k^{\mathsf T} \xi` is the
    slope in an input of deviation :math:`q_k` (for Doppler velocities the azimuth, thesis 7.1).

    Parameters
    ----------
    value : (..., K) array
        Measured values :math:`z_k`.  All magnitudes are at most 1e20.
    sigma, sigma_input : arrays that broadcast to (..., K)
        Standard deviations of the measurement, at least 1e-20, and of its input (not negative).
    gain, slope : (..., K, P) arrays
        :math:`h_k` and :math:`s_k`.
    of_twist : bool
        Whether :math:`\xi` is the twist of the motion (2D only) instead of its parameters.
    """

    value: Array
    sigma: Array
    sigma_input: Array
    gain: Array
    slope: Array
    of_twist: bool

    def __init__(
        self,
        value: ArrayLike,
        sigma: ArrayLike,
        sigma_input: ArrayLike,
        gain: ArrayLike,
        slope: ArrayLike,
        of_twist: bool = False,
    ) -> None:
        arrays = {
            "value": _ANY.array("value", value),
            "sigma": _SIGMA.array("sigma", sigma),
            "sigma_input": _INPUT.array("sigma_input", sigma_input),
            "gain": _ANY.array("gain", gain),
            "slope": _ANY.array("slope", slope),
        }
        check_shape("gain", arrays["gain"], "(..., K, 1)", "(..., K, 3)")
        parameters = arrays["gain"].shape[-1]
        check_shape("slope", arrays["slope"], f"(..., K, {parameters})", like="gain")
        shape = broadcast_batches(
            "value, sigma, sigma_input, gain and slope",
            *(arrays[name].shape for name in ("value", "sigma", "sigma_input")),
            *(arrays[name].shape[:-1] for name in ("gain", "slope")),
        )
        if 0 in shape:
            raise ValueError(f"value must hold at least one target, but has the shape {shape}")
        if of_twist and parameters != 3:
            raise ValueError(f"of_twist needs P = 3 parameters, but gain has {parameters}")
        self._keep("of_twist", check_flag("of_twist", of_twist))
        for name, array in arrays.items():
            full = (*shape, parameters) if name in ("gain", "slope") else shape
            self._keep(name, np.broadcast_to(array, full))

    @property
    def size(self) -> int:
        """Number K of targets."""
        return int(self.value.shape[-1])

    @property
    def parameters(self) -> int:
        """Number P of motion parameters."""
        return int(self.gain.shape[-1])

    @property
    def batch_shape(self) -> tuple[int, ...]:
        """Shape of the leading axes."""
        return self.value.shape[:-1]

    def inflated(self, scale: float) -> "LinearMeasurement":
        """The measurement with all standard deviations times ``scale``, from 1e-50 to 1e50."""
        scale = SCALE.number("scale", scale)
        sigmas = self.sigma * scale, self.sigma_input * scale
        return LinearMeasurement._made(self.value, *sigmas, self.gain, self.slope, self.of_twist)

    @cached_property
    def _packed(self) -> Array:
        """(B K, 9) array that the kernel reads, one row per target."""
        packed = np.zeros((*self.value.shape, 9))
        packed[..., layout.VALUE] = self.value
        packed[..., layout.VARIANCE] = self.sigma**2
        packed[..., layout.INPUT_VARIANCE] = self.sigma_input**2
        packed[..., layout.GAIN : layout.GAIN + self.parameters] = self.gain
        packed[..., layout.SLOPE : layout.SLOPE + self.parameters] = self.slope
        return packed.reshape(-1, 9)
