"""Arrays of the reference: NumPy in double precision; `array` and `numpy` convert from and to single."""

import numpy as np

ON_HOST = True
WARM_FRAMES = 0
DOUBLE = {np.dtype(np.float32): np.float64, np.dtype(np.complex64): np.complex128}
SINGLE = {np.dtype(double): single for single, double in DOUBLE.items()}


class Scratch(dict):
    """float64 arrays by name."""

    def array(self, name, shape, zero=False):
        found = self.setdefault((name, *shape), np.zeros(shape))
        if zero:
            found[:] = 0
        return found


def array(values):
    """A copy in double precision; integers keep their type."""
    return np.array(values, DOUBLE.get(values.dtype, values.dtype))


def photon_array(values):
    return values


def numpy(values):
    """A copy in single precision; integers keep their type."""
    return values.astype(SINGLE.get(values.dtype, values.dtype))


class FrameStream:
    """`submit` computes the frame at once."""

    def __init__(self, function):
        self._function = function

    def submit(self, *frame):
        results = tuple(map(numpy, self._function(*map(array, frame))))
        return lambda: results
