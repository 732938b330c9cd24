"""`acp-lab track --init auto`: start poses that are found in the images, not given."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from acp_lab.commands import console, interrupt
from acp_lab.geometry.arrays import FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame
from acp_lab.sequences.protocol import Sequence

FRAMES_TO_TRY = 30


@dataclass(frozen=True, eq=False)
class FoundStart:
    """Where tracking can begin: the image, and the poses (4, 4) of the objects that were found in it, by id."""

    frame_id: int
    poses: Mapping[int, FloatArray]


def find_starts(sequence: Sequence, models: Mapping[int, PreparedPart]) -> tuple[list[FoundStart], str]:
    """For each object the first of `FRAMES_TO_TRY` frames in which it is found, those of one frame together.

    And one line on those that are found in none of them; empty where all were found.
    """
    from acp_lab.tracking.find import Finder
    from acp_lab.tracking.first_pose import FirstPose

    missing = {object_id: FirstPose(Finder(model)) for object_id, model in models.items()}
    starts = list[FoundStart]()
    frames, camera = 0, None  # of the last image that could be read
    for frame in sequence.frames(FRAMES_TO_TRY):
        if not missing:
            break
        frames += 1
        camera = frame.camera if isinstance(frame, Frame) else camera
        interrupt.check()
        looked = {object_id: search.look(frame) for object_id, search in missing.items()}
        poses = {object_id: pose for object_id, pose in looked.items() if pose is not None}
        if poses:
            starts.append(FoundStart(frame.index, poses))
            console.note(f"scene {sequence.scene_id}: found in image {frame.index}: object {_listed(poses)}")
        missing = {object_id: search for object_id, search in missing.items() if object_id not in poses}
    if not missing:
        return starts, ""
    # All of them were looked for at these distances.
    nearest, farthest = zip(*(_depths_mm(models[one], camera) for one in missing), strict=True)
    near, far = max(nearest), min(farthest)
    return starts, (
        f"--init auto: object {_listed(missing)} is not found in the first {frames} frames of {sequence.name}, "
        f"{near:.0f} to {far:.0f} mm from the camera: give start poses by --init, a results file or for a video a "
        "POSE.json, which notebook 10 sets with the mouse, or look at what acp-lab detect finds, elsewhere by "
        "--depth-mm"
    )


def _depths_mm(model: PreparedPart, camera: Camera | None) -> tuple[float, float]:
    from acp_lab.detection.config import USUAL_DEPTHS_MM, usual_depths_mm

    return USUAL_DEPTHS_MM if camera is None else usual_depths_mm(model.part.diameter, camera)


def _listed(ids: Mapping[int, object]) -> str:
    return ", ".join(map(str, sorted(ids)))
