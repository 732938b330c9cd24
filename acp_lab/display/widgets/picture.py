"""Pictures on their way to the browser: compressed bytes.

Convention: images are (h, w, 3) RGB or (h, w) grey, uint8, as everywhere here.
"""

from __future__ import annotations

import cv2
import numpy as np

from acp_lab.errors import AcpLabError
from acp_lab.geometry.arrays import ByteImage

JPEG_QUALITY = 90


def jpeg_bytes(image: ByteImage | None) -> bytes:
    """A photograph as JPEG; b"" for None and for an image without pixels.

    Raises AcpLabError for another shape or type.
    """
    if image is None or image.size == 0:
        return b""
    if image.dtype != np.uint8 or image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] != 3):
        raise AcpLabError(f"a picture of {image.dtype} {image.shape}: give uint8 pixels (h, w) or RGB (h, w, 3)")
    ordered = cv2.cvtColor(image, cv2.COLOR_RGB2BGR) if image.ndim == 3 else image
    _, encoded = cv2.imencode(".jpg", ordered, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return bytes(encoded)


def image_size(image: ByteImage | None) -> tuple[int, int]:
    """(width, height) px; (0, 0) for None."""
    return (0, 0) if image is None or image.size == 0 else (image.shape[1], image.shape[0])
