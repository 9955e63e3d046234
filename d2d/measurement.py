"""A scalar measurement beside each moving target's position."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from d2d import _kernel
from d2d._checks import Array, broadcast, finite, flag, positive, scalar


@dataclass(frozen=True, eq=False)
class LinearMeasurement:
    """Scalars z_k ~ N(h_k' xi, sigma_k^2 + q_k^2 (s_k' xi)^2), one for each moving target.

    xi is the motion theta itself or its twist, the SE(2) logarithm `d2d.rigid.logarithm`: what
    moves at constant velocity has a constant twist, not a constant direction of translation.

    Its density multiplies the target's inlier density; the outlier component does not know it. The
    variance may grow with the motion: ``s_k' xi`` is the slope of the prediction in an input
    of standard deviation ``q_k`` (for Doppler: the azimuth, thesis sec. 7.1).

    Parameters
    ----------
    value : (..., K) array
        What was measured.
    sigma, sigma_input : arrays that broadcast to (..., K)
        Standard deviations of the measurement (positive) and of its input (zero or more).
    gain, slope : (..., K, P) arrays
        h_k and s_k.
    of_twist : bool
        Whether xi is the twist of the motion (2D) or its parameters.

    Raises
    ------
    ValueError
        Naming the argument: shapes that do not match, nan or inf, a sigma that is not positive.
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
            "value": finite("value", value),
            "sigma": positive("sigma", sigma),
            "sigma_input": finite("sigma_input", sigma_input),
            "gain": finite("gain", gain),
            "slope": finite("slope", slope),
        }
        if (arrays["sigma_input"] < 0).any():
            raise ValueError("sigma_input must not be negative")
        for name in ("gain", "slope"):
            if arrays[name].ndim < 2 or arrays[name].shape[-1] not in (1, 3):
                raise ValueError(
                    f"{name} must have the shape (..., K, P) with P = 1 or 3, "
                    f"but has {arrays[name].shape}"
                )
        if arrays["gain"].shape[-1] != arrays["slope"].shape[-1]:
            raise ValueError("gain and slope must have the same number of parameters")
        shape = broadcast(
            "value, sigma, sigma_input, gain and slope",
            *(arrays[name].shape for name in ("value", "sigma", "sigma_input")),
            *(arrays[name].shape[:-1] for name in ("gain", "slope")),
        )
        if 0 in shape:
            raise ValueError(f"value must hold at least one target, but has the shape {shape}")
        parameters = arrays["gain"].shape[-1]
        of_twist = flag("of_twist", of_twist)
        if of_twist and parameters != 3:
            raise ValueError(f"of_twist needs P = 3 parameters, but gain has {parameters}")
        object.__setattr__(self, "of_twist", of_twist)
        for name, array in arrays.items():
            full = (*shape, parameters) if name in ("gain", "slope") else shape
            object.__setattr__(self, name, np.broadcast_to(array, full))

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
        """The measurement with all standard deviations multiplied by ``scale``.

        Raises ``ValueError`` naming ``scale`` unless it is a positive number.
        """
        scale = float(positive("scale", scalar("scale", scale)))
        return LinearMeasurement(
            self.value,
            self.sigma * scale,
            self.sigma_input * scale,
            self.gain,
            self.slope,
            self.of_twist,
        )

    @cached_property
    def _packed(self) -> Array:
        """(B, K, 9) array as the kernel reads it, one row per target."""
        packed = np.zeros((*self.value.shape, 9))
        packed[..., _kernel.VALUE] = self.value
        packed[..., _kernel.VARIANCE] = self.sigma**2
        packed[..., _kernel.INPUT_VARIANCE] = self.sigma_input**2
        packed[..., _kernel.GAIN : _kernel.GAIN + self.parameters] = self.gain
        packed[..., _kernel.SLOPE : _kernel.SLOPE + self.parameters] = self.slope
        return packed.reshape(-1, self.size, 9)
