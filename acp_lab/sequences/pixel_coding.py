"""How the pixel values of image files are meant, where the file itself does not say.

Industrial cameras store 10, 12 or 14 bits in files of 16, and raw pictures behind a colour filter (Bayer) as if they
were grey. No file tells either, so a small file beside the images does:

    pixels.json    {"bits": 12, "bayer": "rggb"}        both optional

bits: a pixel at full light is 2^bits - 1. bayer: colours of the top-left 2 x 2 pixels, row by row. Without it, 16-bit
files are scaled from their full range, and what looks like 14 bits or fewer in 16 or like a raw picture is refused.
Of several images the first is judged so: those behind it may be dark.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np

from acp_lab.errors import InputFileError
from acp_lab.geometry.arrays import ByteImage
from acp_lab.input_file import read_json_object
from acp_lab.sequences.json_file import shown

FILE_NAME = "pixels.json"
EXAMPLE = '{"bits": 12, "bayer": "rggb"}'
BAYER_CODES = {
    "rggb": cv2.COLOR_BayerRGGB2RGB,
    "grbg": cv2.COLOR_BayerGRBG2RGB,
    "gbrg": cv2.COLOR_BayerGBRG2RGB,
    "bggr": cv2.COLOR_BayerBGGR2RGB,
}
_CHANNEL_CODES = {1: cv2.COLOR_GRAY2RGB, 3: cv2.COLOR_BGR2RGB, 4: cv2.COLOR_BGRA2RGB}
_FEWER_BITS = (12, 14)
_LEAST_DIFFERENCE = 0.03
"""Of the brightness behind the filter's colours; between the sites of a grey picture it is below 0.005."""


@dataclass(frozen=True)
class PixelCoding:
    """bits: the real range of 16-bit files, 8 to 16; bayer: a key of BAYER_CODES. None: nobody said.

    told_in: where they were said, for messages alone. Raises InputFileError for other values.
    """

    bits: int | None = None
    bayer: str | None = None
    told_in: str = field(default=FILE_NAME, compare=False, repr=False)

    def __post_init__(self) -> None:
        if self.bits is not None and (isinstance(self.bits, bool) or self.bits not in range(8, 17)):
            raise InputFileError(f"bits is {shown(self.bits)}: give the bits of a pixel, 8 to 16")
        if self.bayer is not None and self.bayer not in tuple(BAYER_CODES):
            raise InputFileError(f"bayer is {shown(self.bayer)}: give one of {', '.join(BAYER_CODES)}")

    @classmethod
    def beside(cls, folder: Path) -> PixelCoding:
        """What pixels.json in a folder of images says, nothing without one; InputFileError for a malformed one."""
        path = folder / FILE_NAME
        if not path.exists():
            return cls()
        values = read_json_object(path, f"write {EXAMPLE}")
        unknown = [key for key in values if key not in ("bits", "bayer")]
        if unknown:
            raise InputFileError(f"{path}: unknown key {unknown[0]}: write {EXAMPLE}")
        try:
            return cls(values.get("bits"), values.get("bayer"))
        except InputFileError as error:
            raise InputFileError(f"{path}: {error}") from None

    def rgb(self, pixels: np.ndarray, where: str) -> ByteImage:
        """Pixels as OpenCV decodes them, (h, w) or (h, w, channels in BGR), as (h, w, 3) uint8 RGB.

        Grey becomes three equal channels, transparency is dropped, a colour filter is undone. Raises InputFileError,
        beginning with `where`, for pixels that are neither 8 nor 16 bits, have two or more than four channels, or do
        not fit what was declared, and for undeclared ones that look like fewer bits or a raw picture.
        """
        values = self._bytes(pixels, where)
        if self.bayer is not None:
            if values.ndim != 2 or min(values.shape) < 4:
                raise InputFileError(f"{where}: is no raw picture: take bayer {self.bayer} out of {self.told_in}")
            return np.asarray(cv2.cvtColor(values, BAYER_CODES[self.bayer]), dtype=np.uint8)
        if looks_raw(values):
            raise InputFileError(
                f"{where}: looks like a raw picture behind a colour filter: name the filter in {FILE_NAME} beside "
                f"it, as {EXAMPLE}"
            )
        channels = 1 if values.ndim == 2 else values.shape[2]
        if channels not in _CHANNEL_CODES:
            raise InputFileError(f"{where}: image has {channels} channels: convert it to 8-bit RGB")
        return np.asarray(cv2.cvtColor(values, _CHANNEL_CODES[channels]), dtype=np.uint8)

    def behind(self, first: np.ndarray) -> PixelCoding:
        """For the images behind a first one that `rgb` took: if that used 16 bits, they do, however dark one is."""
        return replace(self, bits=16) if self.bits is None and first.dtype == np.uint16 else self

    def _bytes(self, pixels: np.ndarray, where: str) -> ByteImage:
        if pixels.dtype == np.uint8:
            return pixels
        if pixels.dtype != np.uint16:
            raise InputFileError(f"{where}: pixels are {pixels.dtype}: convert the image to 8-bit RGB")
        largest = int(pixels.max())
        # Sensors of 10, 12 or 14 bits are often stored so; scaled from 16 they would come out dark or black.
        fewer = next((bits for bits in _FEWER_BITS if largest < 2**bits), None)
        if self.bits is None and fewer is not None:
            raise InputFileError(
                f"{where}: 16-bit image with values up to {largest} only: say how many bits are meant in {FILE_NAME} "
                f'beside it, as {{"bits": {fewer}}} or, if it is only dark, {{"bits": 16}}, or convert it to 8-bit RGB'
            )
        white = 2 ** (self.bits or 16) - 1
        if largest > white:
            raise InputFileError(
                f"{where}: values up to {largest}, but {self.bits} bits end at {white}: correct {self.told_in}"
            )
        return ((pixels.astype(np.uint32) * 255 + white // 2) // white).astype(np.uint8)


def looks_raw(pixels: np.ndarray) -> bool:
    """Whether grey pixels (h, w) show a colour filter: the four sites of its 2 x 2 pattern differ in brightness, but
    the two green ones, on a diagonal, do not.

    A filter before a sensor that sees all colours alike, or before a grey scene in balanced light, is not noticed.
    """
    if pixels.ndim != 2 or min(pixels.shape) < 64:
        return False
    even = pixels[: pixels.shape[0] // 2 * 2, : pixels.shape[1] // 2 * 2]
    mean = max(float(even.mean()), 1e-9)
    a, b, c, d = (float(even[i::2, j::2].mean()) / mean for i in (0, 1) for j in (0, 1))
    # What chance alone does to the mean of so many pixels, for pictures of pure noise.
    chance = 6.0 * float(even.std()) / np.sqrt(even.size / 4) / mean
    limit = max(_LEAST_DIFFERENCE, chance)
    greens_and_others = (((b, c), (a, d)), ((a, d), (b, c)))
    return any(
        abs(first - second) < limit / 3 and any(abs(other - (first + second) / 2) > limit for other in others)
        for (first, second), others in greens_and_others
    )
