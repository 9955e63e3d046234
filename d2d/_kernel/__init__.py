"""The compiled kernel: the cost, its derivatives and its minimum, for many problems in one call.

- ``layout``: constants, the rows of the scratch array, what a pass over the targets needs
- ``jets``: product, mixture and chain rule of densities with their derivatives
- ``pairs``: the double sum over targets and components
- ``neighbours``: which components are near each target, kept from step to step
- ``densities``: the outlier component and the measurements
- ``tiles``: the corrupted Gaussian's component of a large set, interpolated
- ``charts``: a motion, its twist, the velocity that causes it
- ``cost``: the cost of one or several pairs of sets with its derivatives
- ``newton``: its minimum, by steps in a trust region
- ``propagate``: how the gradient changes with every measured coordinate
- ``errors``: what the errors of the targets of a set do to the gradient
- ``consensus``: the velocity that most Doppler velocities agree with
- ``elementary``: exponential and logarithm that vectorise
- ``compile``: how functions are compiled and kept
- ``entries``: what Python calls, with ``tiles``, ``propagate``, ``errors`` and ``consensus``
"""
