"""The array that make_zarr.py and make_hdf5.py write in their formats."""

import numpy as np

SHAPE = (7, 10, 9)  # z, y, x


def numbers(dtype, shape=SHAPE):
    """Values of an array whose last axes are z, y, x; the axes before them are c, or t and c."""
    index = np.indices(shape, dtype=np.int64)
    z, y, x = index[-3:]
    c = index[-4] if len(shape) > 3 else 0
    t = index[-5] if len(shape) > 4 else 0
    n = x * x + 7 * y + 40 * z + 300 * c + 1000 * t
    kind = np.dtype(dtype)
    if kind == bool:
        return n % 3 == 0
    if kind.kind == "f":
        return (n / 8).astype(kind)
    return (n % 251 if kind.itemsize == 1 else n).astype(kind)
