"""Names for the array types that the signatures use; each docstring gives the shapes."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray: TypeAlias = NDArray[np.float64]
"""Geometry: always float64."""
Float32Array: TypeAlias = NDArray[np.float32]
"""Distance maps and whatever networks see."""
IntArray: TypeAlias = NDArray[np.int64]
Int32Array: TypeAlias = NDArray[np.int32]
Uint16Array: TypeAlias = NDArray[np.uint16]
BoolArray: TypeAlias = NDArray[np.bool_]
ByteImage: TypeAlias = NDArray[np.uint8]
"""(h, w) grey or (h, w, 3) RGB."""


_FLOAT64 = np.dtype(np.float64)


def writable(image: ByteImage) -> ByteImage:
    """An image as compiled loops take it; a copy only of one that is read-only."""
    return image if image.flags.writeable else image.copy()


def plain(array: ArrayLike) -> FloatArray:
    """An array as compiled loops take it: float64, row by row, writable; a copy only of one that is not."""
    if type(array) is np.ndarray and array.dtype is _FLOAT64 and array.flags.carray:
        return array
    return np.array(array, np.float64, order="C")
