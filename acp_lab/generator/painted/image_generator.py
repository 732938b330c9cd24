"""The paper's t(I) at run time: control points in, edge image out (paper IV-A, eq. 5), and its derivative.

Convention: control points are (4, 2) canonical px, in the order of W's rows; images (size, size) float32 in [0, 1].
Everything runs in one thread: the images are small, and threads would wait for each other longer than they work.
torch is imported when a region is first used, so that a prepared part can be read without it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from acp_lab.errors import PaintingFrameError, PreparationError
from acp_lab.generator.device import Device, repeatable_convolutions, torch_device
from acp_lab.generator.one_thread import one_thread
from acp_lab.generator.painted.edge_images import PaintingFrame
from acp_lab.geometry.arrays import Float32Array, FloatArray

if TYPE_CHECKING:
    import torch
    from torch.nn import Module

    from acp_lab.generator.painted.autoencoder import Decoder
    from acp_lab.generator.painted.config import NetworkShape
    from acp_lab.generator.painted.latent_regressor import LatentRegressor

PointSet = Literal["regressed", "mid-section"]
"""Which W the control points are the image of: the regressed one, or the box's middle section as it is."""
POINT_SETS: tuple[PointSet, ...] = get_args(PointSet)


@dataclass(frozen=True)
class RegionAutoencoder:
    """What is stored of one region: a decoder, and a regressor of its latent code for each W.

    Attributes:
        tensors: weights by name, "decoder.*", "regressed.*" and "mid-section.*"; matrices in float16.
        sizes: (7,) image size, latent length, the decoder's three widths, the regressors' width; last a format number.
        points_obj: (2, 4, 3) mm, W regressed and W of the middle section.
        frame: where its canonical frame stands.
    """

    tensors: Mapping[str, np.ndarray]
    sizes: np.ndarray
    points_obj: FloatArray
    frame: PaintingFrame = "pose"

    FORMAT = 2
    PREDICTION_FORMAT = 1
    """Of networks for a frame at the prediction; those of earlier versions have it, since that was all there was."""

    @property
    def size(self) -> int:
        """Side of its images, px."""
        return int(self.sizes[0])

    def arrays(self) -> dict[str, np.ndarray]:
        """All of it as arrays by name, for a safetensors file."""
        return {**self.tensors, "sizes": self.sizes, "points_obj": self.points_obj}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, np.ndarray]) -> RegionAutoencoder:
        """The inverse of `arrays`; raises KeyError or ValueError for any other arrays."""
        rest = dict(arrays)
        sizes, points_obj = rest.pop("sizes"), rest.pop("points_obj")
        frames: dict[int, PaintingFrame] = {cls.FORMAT: "pose", cls.PREDICTION_FORMAT: "prediction"}
        if sizes.shape != (7,) or int(sizes[-1]) not in frames or points_obj.shape != (2, 4, 3):
            raise ValueError("not an auto-encoder of this program's format")
        return cls(rest, sizes, points_obj, frames[int(sizes[-1])])

    @classmethod
    def of_networks(
        cls,
        shape: NetworkShape,
        decoder: Decoder,
        regressors: Mapping[PointSet, LatentRegressor],
        points_obj: Mapping[PointSet, FloatArray],
        frame: PaintingFrame = "pose",
    ) -> RegionAutoencoder:
        """Trained networks, their matrices rounded to float16, which halves the file."""
        modules: dict[str, Module] = {"decoder": decoder}
        modules.update({str(name): regressor for name, regressor in regressors.items()})
        tensors = {
            f"{name}.{key}": _rounded(value.detach().cpu().numpy())
            for name, module in modules.items()
            for key, value in module.state_dict().items()
        }
        number = cls.FORMAT if frame == "pose" else cls.PREDICTION_FORMAT
        sizes = np.array([shape.size, shape.latent, *shape.widths, shape.hidden, number], np.int32)
        return cls(tensors, sizes, np.stack([points_obj[name] for name in POINT_SETS]), frame)


@dataclass(frozen=True)
class _Networks:
    decoder: Decoder
    regressors: Mapping[PointSet, LatentRegressor]
    device: torch.device

    def moved(self, on: torch.device) -> _Networks:
        """The same networks on a device."""
        regressors = {name: regressor.to(on) for name, regressor in self.regressors.items()}
        return _Networks(self.decoder.to(on), regressors, on)


class AutoencoderGenerator:
    """t(I) by the two-stage network, one per trained view region."""

    name = "autoencoder"

    def __init__(
        self, autoencoders: Mapping[int, RegionAutoencoder], part_name: str = "part", device: Device = "cpu"
    ) -> None:
        """device: where the networks paint."""
        if not autoencoders:
            raise PreparationError(f"{part_name}: no auto-encoder; run acp-lab prepare with --generator autoencoder")
        self._stored = dict(autoencoders)
        self._part_name = part_name
        self._device = device
        self._networks: dict[int, _Networks] = {}

    @property
    def regions(self) -> tuple[int, ...]:
        """The view regions 0..5 that were trained, ascending."""
        return tuple(sorted(self._stored))

    @property
    def size(self) -> int:
        """Side of the images, px; the same in all regions."""
        return next(iter(self._stored.values())).size

    @property
    def frame(self) -> PaintingFrame:
        """Where its canonical frame stands; the same in all regions."""
        return next(iter(self._stored.values())).frame

    def check_frame(self, wanted: PaintingFrame) -> None:
        """PaintingFrameError when it was trained for the other frame, as those of earlier versions were."""
        if self.frame != wanted:
            raise PaintingFrameError(
                f"{self._part_name}: its auto-encoder paints in a frame at the {self.frame}, this method needs one at "
                f"the {wanted}; run acp-lab prepare with --generator autoencoder --painting-frame {wanted}"
            )

    def points_obj(self, region: int, point_set: PointSet = "regressed") -> FloatArray:
        """(4, 3) mm: the W that the region's network was trained with; raises PreparationError if it was not."""
        points: FloatArray = self._region(region).points_obj[POINT_SETS.index(point_set)]
        return points

    def edge_image(self, canonical_points: FloatArray, region: int, point_set: PointSet = "regressed") -> Float32Array:
        """(size, size) E = t(I), eq. 5; raises PreparationError for a region that was not trained."""
        return self.edge_images(canonical_points[None], region, point_set)[0]

    def edge_images(self, canonical_points: np.ndarray, region: int, point_set: PointSet = "regressed") -> Float32Array:
        """(b, size, size) for control points (b, 4, 2)."""
        return self.painted(self.latent_codes(canonical_points, region, point_set), region)

    def latent_codes(
        self, canonical_points: np.ndarray, region: int, point_set: PointSet = "regressed"
    ) -> Float32Array:
        """(b, latent), the output of the stage-two regressor for control points (b, 4, 2)."""
        networks = self._loaded(region)
        import torch

        with one_thread(), torch.inference_mode():
            inputs = torch.from_numpy(np.asarray(canonical_points, np.float32).reshape(-1, 8)).to(networks.device)
            codes: Float32Array = networks.regressors[point_set](inputs).cpu().numpy()
        return codes

    def painted(self, latent_codes: np.ndarray, region: int) -> Float32Array:
        """(b, size, size), what the decoder paints for codes (b, latent), also for codes that no regressor produces."""
        networks = self._loaded(region)
        import torch

        with one_thread(), repeatable_convolutions(networks.device), torch.inference_mode():
            logits = networks.decoder(torch.from_numpy(np.asarray(latent_codes, np.float32)).to(networks.device))
            images: Float32Array = torch.sigmoid(logits)[:, 0].cpu().numpy()
        return images

    def edge_image_derivatives(
        self, canonical_points: FloatArray, region: int, point_set: PointSet = "regressed"
    ) -> tuple[Float32Array, Float32Array]:
        """E (size, size) and dE/dI (size, size, 8), per canonical px, of control points (4, 2).

        Forward mode: eight directions go through the network beside the value, some five times the work of E alone.
        """
        networks = self._loaded(region)
        import torch

        def with_value(inputs: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
            code = networks.regressors[point_set](inputs[None])
            image = torch.sigmoid(networks.decoder(code))[0, 0]
            return image, image

        with one_thread(), repeatable_convolutions(networks.device), torch.no_grad():
            inputs = torch.from_numpy(np.asarray(canonical_points, np.float32).reshape(8)).to(networks.device)
            derivatives, image = torch.func.jacfwd(with_value, has_aux=True)(inputs)
        return image.cpu().numpy(), derivatives.contiguous().cpu().numpy()

    def _region(self, region: int) -> RegionAutoencoder:
        if region not in self._stored:
            trained = ", ".join(map(str, self.regions))
            raise PreparationError(
                f"{self._part_name}: the auto-encoder of view region {region} is not trained (only {trained}); "
                f"run acp-lab prepare with --generator autoencoder --regions {region}"
            )
        return self._stored[region]

    def _loaded(self, region: int) -> _Networks:
        if region not in self._networks:
            import torch

            stored, on = self._region(region), torch_device(self._device)
            try:
                networks = _load(stored)
            except (RuntimeError, PreparationError) as error:  # torch's words for missing and misshapen weights
                raise PreparationError(
                    f"{self._part_name}: the auto-encoder of view region {region} is damaged "
                    f"({str(error).splitlines()[0]}); run acp-lab prepare with --generator autoencoder --no-resume"
                ) from None
            try:
                self._networks[region] = networks.moved(on)
            except torch.OutOfMemoryError:
                raise PreparationError(
                    f"{self._part_name}: the GPU has no memory left for the auto-encoder of view region {region}: "
                    'free some, or paint with device="cpu"'
                ) from None
        return self._networks[region]


def _load(stored: RegionAutoencoder) -> _Networks:
    import torch

    from acp_lab.generator.painted.autoencoder import Decoder
    from acp_lab.generator.painted.config import NetworkShape
    from acp_lab.generator.painted.latent_regressor import LatentRegressor

    size, latent, coarse, middle, fine, hidden, _ = stored.sizes.tolist()
    shape = NetworkShape(size, latent, (coarse, middle, fine), hidden)
    with torch.random.fork_rng(devices=[]):
        decoder = Decoder(shape)
        regressors: dict[PointSet, LatentRegressor] = {name: LatentRegressor(shape) for name in POINT_SETS}
    modules: dict[str, Module] = {"decoder": decoder}
    modules.update({str(name): regressor for name, regressor in regressors.items()})
    for name, module in modules.items():
        start = f"{name}."
        module.load_state_dict(
            {
                key.removeprefix(start): torch.from_numpy(np.asarray(value, np.float32))
                for key, value in stored.tensors.items()
                if key.startswith(start)
            }
        )
        module.requires_grad_(False).eval()
    return _Networks(decoder, regressors, torch.device("cpu"))


def _rounded(value: np.ndarray) -> np.ndarray:
    # The whitening of the control points must stay exact: its axes differ by a factor of some hundreds.
    is_weight = value.ndim >= 2 and value.shape != (8, 8)
    return np.array(value, np.float16 if is_weight else np.float32)
