"""The part's last picture, kept for the next frame: where it is found there corrects what the motion foretold."""

from __future__ import annotations

import numpy as np

from acp_lab.cad.part import Part, box_corners
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import transform
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.picture import Picture, PictureSearch, take_picture
from acp_lab.tracking.prediction import Predictor


class PictureMemory:
    """The last picture of one tracked part.

    kept: it, with the pose (4, 4) and the camera that it was taken at; None where there is none.
    """

    def __init__(self, part: Part, config: PictureSearch) -> None:
        self._part, self._config = part, config
        self._corners_obj = box_corners(part)
        self.forget()

    def forget(self) -> None:
        """Before a new track."""
        self.kept: tuple[Picture, FloatArray, Camera] | None = None

    def take(self, frame: Frame, cam_T_obj: FloatArray) -> None:
        """Take the part's picture at a pose (4, 4), in place of the last one."""
        picture = take_picture(frame, self._corners_obj, cam_T_obj, self._config)
        self.kept = None if picture is None else (picture, cam_T_obj, frame.camera)

    def correct(self, predictor: Predictor, frame: Frame, px: float = 1.0) -> None:
        """Tell the predictor where in the frame the picture is, unless that says nothing new.

        px: so many px of the frame are one of those that edges are seen in; more than 1 for a large part.
        """
        if self.kept is None:
            return
        config, (picture, pose, camera) = self._config, self.kept
        if frame.camera != camera:
            return  # places in the two images cannot be compared
        centres_cam = [transform(at, self._part.box_centre) for at in (pose, predictor.predict())]
        before_px, expected_px = frame.camera.project(np.array(centres_cam))
        if not np.isfinite(before_px + expected_px).all():
            return
        shift_px = picture.shift_in(frame.image, expected_px - before_px, config)
        if shift_px is not None and np.linalg.norm(before_px + shift_px - expected_px) > px * config.least_px:
            predictor.sight(frame.camera, before_px + shift_px, px * config.scatter_px, config.doubt)
