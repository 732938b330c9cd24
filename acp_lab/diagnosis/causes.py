"""The causes of bad tracking: one function per cause, each with one measured quantity and one limit.

A function takes the quantity and returns a `Finding`, with a sentence and advice, when the quantity passes its limit;
else None.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

from acp_lab.control_points.view_regions import HYSTERESIS
from acp_lab.geometry.camera import Camera


class Cause(StrEnum):
    """What can be wrong with a frame, or with the whole run."""

    UNREADABLE = "unreadable image"
    FEW_EDGES = "few edges found"
    OCCLUSION = "occlusion"
    CLUTTER = "clutter of the same direction"
    APPEARANCE = "changed appearance"
    FAST_MOTION = "motion beyond the search range"
    REGION_BORDER = "border of a view region"
    DEGENERATE_POINTS = "near-degenerate control points"
    OUTSIDE_IMAGE = "part partly outside the image"
    UNIT_OR_CAMERA = "wrong unit or intrinsics"
    WRONG_START = "wrong start pose, unit or camera"


@dataclass(frozen=True)
class DiagnosisConfig:
    """Limits beyond which a cause is named. They were set on sequences with and without the problem.

    Attributes:
        good_evidence: share of the usual `confidence.weight_of_evidence` from which a frame counts as good.
        found_share: of the edge points; when fewer have an image edge, few edges are found.
        contrast: median gradient across the edges, grey levels per px, below which the edges count as faint.
        hidden_share: of the edge points; from here on a connected set of missing points counts as occluded.
        rivals: strong image edges per edge point that belong to no edge of the part.
        likeness: by what factor their evidence fell more than the share of edges found.
        recovery_px: how much further the tracker's recovery searches than the first level.
        quad_opening: least height of the control-point quad as a share of its size.
        outside_share: of the visible edge points.
        depth_change: of the first poses, as a logarithm, relative to the start pose.
        principal_point: distance from the middle of the image, as a share of its width.
        focal_ratio: of fx to fy, away from 1.
        apparent_px: size of the part in the image, below which it has too few pixels.
    """

    good_evidence: float = 0.75
    found_share: float = 0.5
    contrast: float = 4.0
    hidden_share: float = 0.12
    rivals: float = 0.8
    likeness: float = 1.25
    recovery_px: float = 10.0
    quad_opening: float = 0.12
    outside_share: float = 0.1
    depth_change: float = 0.06
    principal_point: float = 0.25
    focal_ratio: float = 0.1
    apparent_px: float = 25.0


@dataclass(frozen=True)
class Finding:
    """A cause with its measurement.

    Attributes:
        cause: what is wrong; text: a sentence with the measured quantity.
        advice: the setting or the action that helps.
        measured, limit: the quantity, and from where on it counts as a cause.
        severity: the factor by which the limit is passed, 1 or more.
    """

    cause: Cause
    text: str
    advice: str
    measured: float
    limit: float
    severity: float


def unreadable(reason: str) -> Finding:
    """The image cannot be decoded."""
    return Finding(Cause.UNREADABLE, reason, "replace the image, or leave the frame out", 1.0, 1.0, 100.0)


def few_edges(found_share: float, contrast: float, config: DiagnosisConfig) -> Finding | None:
    """Too few of the visible edges are found, or they are faint; contrast in grey levels per px."""
    advice = (
        "a free view of the part (is something before it?), more light, a shorter exposure or a sharper lens; with "
        "other methods, --method acp, which sees colours; by --config targets.search.contrast lower, so that "
        "faint edges count"
    )
    text = (
        f"{100.0 * found_share:.0f}% of the visible edges are found in the image, and the median contrast across them "
        f"is {contrast:.1f} grey levels per px."
    )
    few = _below(Cause.FEW_EDGES, f"only {text}", advice, found_share, config.found_share)
    return few or _below(Cause.FEW_EDGES, text, advice, contrast, config.contrast)


def wrong_start(frames: int) -> Finding:
    """No frame was good: what the tracker was given is more likely wrong than anything that an image shows."""
    return Finding(
        Cause.WRONG_START,
        f"none of {frames} frames was good, the first one included: the start pose, the unit of the mesh or the camera "
        "is likely wrong.",
        "acp-lab track --init auto, which finds the part, or a start pose that is set with the PoseAligner of notebook "
        "10; check that mesh and start pose are in mm, and fx and fy of this image size",
        1.0,
        1.0,
        100.0,
    )


def occlusion(hidden_share: float, config: DiagnosisConfig, was_good: bool = True) -> Finding | None:
    """Something hides the part. was_good: ever before; else no setting can bridge it, or spoil what was learnt."""
    settings = (
        "; by --config states.patience higher, which bridges short occlusions, and learning.learn_above higher, which "
        "keeps the tracker from learning the occluder"
    )
    return _above(
        Cause.OCCLUSION,
        f"{100.0 * hidden_share:.0f}% of the visible edges, in one connected region, are missing or changed colour "
        "on both sides.",
        f"keep the view of the part free{settings if was_good else ''}",
        hidden_share,
        config.hidden_share,
    )


def clutter(rivals_per_point: float, reach_px: int, config: DiagnosisConfig) -> Finding | None:
    """Other image edges run parallel to the part's own."""
    return _above(
        Cause.CLUTTER,
        f"on average {rivals_per_point:.1f} other strong image edges of the same direction lie within {reach_px} px of "
        "an edge point.",
        "a plainer background; by --config schedule.levels with a shorter reach_px, or learning.memory.grey_floor "
        "and learning.memory.gradient_floor lower, so that the remembered look of an edge counts more",
        rivals_per_point,
        config.rivals,
    )


def appearance(found_share: float, found_before: float, quality_kept: float, config: DiagnosisConfig) -> Finding | None:
    """The edges are found, but no longer look as the tracker remembers them."""
    return _above(
        Cause.APPEARANCE,
        f"{100.0 * found_share:.0f}% of the edges are found ({100.0 * found_before:.0f}% before), but they look "
        f"different: what they say for the pose fell to {100.0 * quality_kept:.0f}%.",
        "steadier light; by --config learning.memory.rate higher, so that the memory follows reflections, or "
        "learning.memory.gradient_floor and learning.memory.grey_floor higher, so that it counts less",
        found_share / max(found_before, 1e-6) / max(quality_kept, 1e-6),
        config.likeness,
    )


def fast_motion(innovation_px: float, reach_px: int, config: DiagnosisConfig) -> Finding | None:
    """The part moved out of the search range; the innovation is its distance from the prediction."""
    return _above(
        Cause.FAST_MOTION,
        f"the part was {innovation_px:.0f} px from its predicted position; image edges are searched for within "
        f"{reach_px} px.",
        f"more frames per second; by --config schedule.levels, the first one's reach_px of at least "
        f"{math.ceil(innovation_px)}; where the method has a sight, as acp has, sight.reach larger, too, so that the "
        "part's last picture is found",
        innovation_px,
        reach_px + config.recovery_px,
    )


def region_border(closeness: float, changes: int) -> Finding | None:
    """The view lies between two view regions; closeness in [0, 1] is 1 on the border itself."""
    if changes == 0:
        return None
    return _above(
        Cause.REGION_BORDER,
        f"the view lies on the border of two view regions (the second scores {100.0 * closeness:.0f}% of the "
        f"first), and the region changed {changes} time{'s'[: changes != 1]} since the problem began.",
        "prepare both regions: acp-lab prepare --regions all, of methods with an auto-encoder with --generator "
        "autoencoder; a start that looks at the part from another side",
        closeness,
        1.0 / HYSTERESIS**2,
    )


def degenerate_points(opening: float, region: str, config: DiagnosisConfig) -> Finding | None:
    """The control points are nearly collinear; opening is the quad's least height as a share of its size."""
    return _below(
        Cause.DEGENERATE_POINTS,
        f"the control points are nearly collinear: their quad is {100.0 * opening:.0f}% as high as it is wide.",
        f"another view of the part: the control points of view region {region} are seen too obliquely",
        opening,
        config.quad_opening,
    )


def outside_image(share: float, config: DiagnosisConfig) -> Finding | None:
    """Part of the part is outside the image."""
    return _above(
        Cause.OUTSIDE_IMAGE,
        f"{100.0 * share:.0f}% of the part's visible edges lie outside the image.",
        "keep the part in view, or use a wider lens; no setting replaces what the image does not show",
        share,
        config.outside_share,
    )


def unit_or_camera(
    camera: Camera, start_depth_mm: float, first_depth_mm: float, apparent_px: float, config: DiagnosisConfig
) -> Finding | None:
    """Unit or intrinsics contradict the image, or fit no real camera; the worst of four signs.

    Args:
        start_depth_mm, first_depth_mm: of the part's centre, in the start pose and in the first tracked frames.
        apparent_px: how large the part is at the start pose.
    """
    advice = (
        "check fx and fy of the camera (are they of this image size?), the unit of the mesh and of the start pose "
        "(mm), and the start pose itself"
    )
    ratio = max(first_depth_mm / start_depth_mm, 1e-6)
    off = math.hypot(camera.cx - 0.5 * camera.width, camera.cy - 0.5 * camera.height) / camera.width
    signs = (
        _above(
            Cause.UNIT_OR_CAMERA,
            f"the image fits the part at {first_depth_mm:.0f} mm, the start pose puts it at {start_depth_mm:.0f} mm: "
            f"focal length or part size seem wrong by a factor of {ratio:.2f}.",
            advice,
            abs(math.log(ratio)),
            config.depth_change,
        ),
        _below(
            Cause.UNIT_OR_CAMERA,
            f"at the start pose the part is only {apparent_px:.0f} px across.",
            advice,
            apparent_px,
            config.apparent_px,
        ),
        _above(
            Cause.UNIT_OR_CAMERA,
            f"the principal point ({camera.cx:.0f}, {camera.cy:.0f}) is far from the middle of the image of "
            f"{camera.width} x {camera.height} px.",
            advice,
            off,
            config.principal_point,
        ),
        _above(
            Cause.UNIT_OR_CAMERA,
            f"fx = {camera.fx:.0f} px and fy = {camera.fy:.0f} px differ more than those of real cameras.",
            advice,
            abs(camera.fx / camera.fy - 1.0),
            config.focal_ratio,
        ),
    )
    return max((sign for sign in signs if sign), key=lambda sign: sign.severity, default=None)


def _above(cause: Cause, text: str, advice: str, measured: float, limit: float) -> Finding | None:
    severity = measured / limit
    return Finding(cause, text, advice, measured, limit, severity) if severity >= 1.0 else None


def _below(cause: Cause, text: str, advice: str, measured: float, limit: float) -> Finding | None:
    severity = min(limit / max(measured, 1e-9), 100.0)
    return Finding(cause, text, advice, measured, limit, severity) if severity > 1.0 else None
