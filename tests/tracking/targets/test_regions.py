"""Colours on lines across the outline: where they lie, where they see the part end, and what the solver makes of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from acp_lab.cad.part import Part
from acp_lab.cad.raycast import hit_map, make_caster
from acp_lab.errors import TrackingError
from acp_lab.generator.base import GeneratedEdges
from acp_lab.geometry.arrays import BoolArray, ByteImage, FloatArray
from acp_lab.geometry.camera import Camera
from acp_lab.geometry.pose import disturb_pose, transform
from acp_lab.geometry.pose_step import centre_position, image_directions, move_pose
from acp_lab.prepared_part import PreparedPart
from acp_lab.sequences.frame import Frame
from acp_lab.tracking.frame_solver import FrameSolver
from acp_lab.tracking.frame_view import Estimate
from acp_lab.tracking.method import ACP
from acp_lab.tracking.priors import ControlPointDamping
from acp_lab.tracking.schedule import Level
from acp_lab.tracking.solution import SeenFrame
from acp_lab.tracking.start import LOOK_LEVEL
from acp_lab.tracking.stopwatch import Stopwatch
from acp_lab.tracking.targets.normals import NormalSearch
from acp_lab.tracking.targets.regions import (
    CorrespondenceLines,
    FreeLengths,
    RegionLines,
    RegionMeasure,
    RegionMemory,
    RegionTarget,
)
from acp_lab.tracking.tracker import Tracker
from tests.made_parts import box, bracket, cylinder, looking_at
from tests.tracking.rendered import MadeSequence, add_percent, prepared

# Larger than that of `rendered`, for tenths of a pixel.
CAMERA = Camera(width=400, height=320, fx=640.0, fy=650.0, cx=199.5, cy=159.5)
PART_COLOUR, GROUND_COLOUR = (180, 60, 40), (40, 90, 150)
COARSE, FINE = Level(14, 5.0, 400), Level(5, 1.0, 400)
ACP_REGIONS = replace(ACP, targets=(NormalSearch(), RegionLines()))
WITHOUT_REGIONS = replace(ACP, targets=(NormalSearch(),))
# No image edge is as good as that, so that regions decide alone.
REGIONS_ALONE = replace(
    ACP,
    targets=(NormalSearch(min_score=0.999999, precision=1e-6), RegionLines()),
    priors=(ControlPointDamping(1e-4),),
)


@pytest.fixture
def truth(part: Part) -> FloatArray:
    return looking_at(part, np.array([0.8, 0.6, 1.0]), 330.0, 0.3)


def mask_of(part: Part, cam_T_obj: FloatArray, shift: FloatArray | tuple[float, float] = (0.0, 0.0)) -> BoolArray:
    """(h, w) where the part shows, moved by a shift (x, y) px."""
    camera = replace(CAMERA, cx=CAMERA.cx + shift[0], cy=CAMERA.cy + shift[1])
    _, face = hit_map(part, make_caster(part), camera, cam_T_obj)
    return np.asarray(face >= 0)


def painted(
    mask: BoolArray,
    inside: tuple[int, int, int] = PART_COLOUR,
    outside: tuple[int, int, int] = GROUND_COLOUR,
) -> ByteImage:
    """Two flat colours."""
    return np.where(mask[..., None], np.array(inside, np.uint8), np.array(outside, np.uint8))


@dataclass
class Looked:
    """One frame of a part, with the target that sees its regions and what this keeps."""

    solver: FrameSolver
    seen: SeenFrame

    @property
    def target(self) -> RegionTarget:
        found = self.seen.targets[1]
        assert isinstance(found, RegionTarget)
        return found

    @property
    def memory(self) -> RegionMemory:
        return self.target.memory

    def at(self, cam_T_obj: FloatArray) -> Estimate:
        return self.seen.view.at_pose(cam_T_obj)

    def edges(self, cam_T_obj: FloatArray, count: int = 400) -> GeneratedEdges:
        return self.solver.source.generate(self.at(cam_T_obj), count)

    def lines(self, cam_T_obj: FloatArray) -> CorrespondenceLines:
        return self.target.lines(self.edges(cam_T_obj), self.at(cam_T_obj))

    def measure(self, cam_T_obj: FloatArray, level: Level, edges: GeneratedEdges | None = None) -> RegionMeasure:
        return self.target.bind(edges or self.edges(cam_T_obj, level.samples), self.at(cam_T_obj), level)

    def learn(self, cam_T_obj: FloatArray, trusted: bool = True) -> None:
        """As the first frame does, when its pose is trusted."""
        looked = self.solver.look_at(self.seen, self.at(cam_T_obj), LOOK_LEVEL, Stopwatch())
        assert looked is not None
        for judgement in looked.judgements:
            judgement.learn(trusted)

    def next(self, image: ByteImage) -> Looked:
        """Another frame of the same part."""
        seen = self.solver.look(image, CAMERA, self.seen.view.prior, self.seen.view.region)
        assert seen is not None
        return Looked(self.solver, seen)


def looked_at(model: PreparedPart, image: ByteImage, prior: FloatArray, method: object = ACP_REGIONS) -> Looked:
    solver = FrameSolver(model, method)  # type: ignore[arg-type]
    seen = solver.look(image, CAMERA, prior, 4)
    assert seen is not None
    return Looked(solver, seen)


@pytest.fixture
def taught(part: Part, model: PreparedPart, truth: FloatArray) -> Looked:
    """A frame of two flat colours which are known."""
    found = looked_at(model, painted(mask_of(part, truth)), truth)
    found.learn(truth)
    return found


# ---- where lines are -----------------------------------------------------------------------------------------


def test_lines_look_off_the_part(part: Part, taught: Looked, truth: FloatArray) -> None:
    lines, mask = taught.lines(truth), mask_of(part, truth)
    assert len(lines) > 0.9 * min(taught.edges(truth).outline.sum(), 200)
    np.testing.assert_allclose(np.linalg.norm(lines.outward, axis=1), 1.0, atol=1e-9)

    def on_part(way_px: float) -> FloatArray:
        x, y = np.rint(lines.points + way_px * lines.outward).astype(int).T
        return mask[y, x].astype(float)

    assert on_part(-1.5).mean() > 0.97
    assert on_part(1.5).mean() < 0.03


def test_how_far_lines_are_free_is_seen_in_the_rendered_mask() -> None:
    """Two rails of 6 mm with a gap of 4 mm: lines end at the other side of each, and where the other one begins."""
    rails = [box((50.0, 6.0, 6.0), (0.0, y, 0.0)) for y in (-5.0, 5.0)]
    faces = [rails[0].faces, rails[1].faces + len(rails[0].vertices)]
    part = Part.from_mesh(np.concatenate([rail.vertices for rail in rails]), np.concatenate(faces), "rails")
    pose = looking_at(part, np.array([0.1, 0.15, 1.0]), 330.0, 0.3)
    mask = mask_of(part, pose)
    far = replace(ACP, targets=(NormalSearch(), RegionLines(reach_px=24.0)))
    looked = looked_at(prepared(part), painted(mask), pose, far)
    lines = looked.lines(pose)
    assert len(lines) > 50
    way = np.arange(1.0, 25.0)
    for sign, free, wanted in ((-1.0, lines.free[0], True), (1.0, lines.free[1], False)):
        points = lines.points[:, None] + sign * way[:, None] * lines.outward[:, None]
        x, y = np.rint(np.moveaxis(points, 2, 0)).astype(int)
        until = np.cumprod(mask[y, x] == wanted, axis=1).sum(1)
        # Rays go in steps of 2 px, and the mask's pixels are whole ones; glancing past a corner differs more.
        assert (np.abs(until - free) <= 3.0).mean() > 0.9
        assert free.max() == looked.memory.config.reach_px
        assert (free < 20.0).mean() > 0.15


def test_an_outline_before_the_part_itself_is_no_line(model: PreparedPart, part: Part) -> None:
    """One arm of the bracket hides a piece of the other: its outline there has no background behind."""
    pose = looking_at(part, np.array([-0.6, 1.0, 0.5]), 330.0, 0.3)
    mask = mask_of(part, pose)
    looked = looked_at(model, painted(mask), pose)
    edges, lines = looked.edges(pose), looked.lines(pose)
    rows = np.flatnonzero(edges.outline)
    beside = edges.points[rows, None] + np.array([-4.0, 4.0])[:, None] * edges.normals[rows, None]
    x, y = np.rint(np.moveaxis(beside, 2, 0)).astype(int)
    inner = rows[mask[y, x].all(1)]
    assert len(inner) >= 10
    assert not np.isin(lines.rows, inner).any()
    assert len(lines) > 0.6 * (len(rows) - len(inner))


# ---- where the part ends -------------------------------------------------------------------------------------


@pytest.mark.parametrize(("scale", "shifts"), [(1, (0.6, 2.0)), (2, (1.5, 4.0)), (4, (3.0, 8.0))])
def test_the_posterior_finds_an_outline_that_was_shifted(
    part: Part, taught: Looked, truth: FloatArray, scale: int, shifts: tuple[float, ...]
) -> None:
    """In every direction: the image moves, the lines stay. Residuals of the measure lie along the points' normals."""
    found, expected, counted = [], [], []
    for length in shifts:
        for angle in np.arange(8) * np.pi / 4.0 + 0.2:
            shift = length * np.array([np.cos(angle), np.sin(angle)])
            lines = taught.next(painted(mask_of(part, truth, shift))).lines(truth)
            found_px, weights = lines.posterior(scale, RegionLines().fade_px)
            clear = weights > 0.5
            found.append(found_px[clear])
            expected.append((lines.outward @ shift)[clear])
            counted.append(clear.mean())
    wanted = np.concatenate(expected)
    off = np.concatenate(found) - wanted
    assert min(counted) > 0.9
    # Colours are read at whole pixels, or segments of them: what is left is their rounding.
    assert np.polyfit(wanted, wanted + off, 1)[0] == pytest.approx(1.0, abs=0.1)
    assert abs(off.mean()) < 0.15 * scale
    assert np.sqrt((off**2).mean()) < 0.5 * scale


def test_residuals_lie_along_the_edge_points_own_normals(part: Part, taught: Looked, truth: FloatArray) -> None:
    shift = np.array([1.6, -1.2])
    after = taught.next(painted(mask_of(part, truth, shift)))
    edges = after.edges(truth)
    flipped = replace(edges, tangents=-edges.tangents)
    for each in (edges, flipped):
        said = after.measure(truth, COARSE, each)(each)
        lines = said.weights > 0.3
        assert lines.sum() > 30
        np.testing.assert_array_equal(said.directions, each.normals)
        rest = (said.residuals - each.normals @ shift)[lines]
        assert abs(rest.mean()) < 0.4
        assert np.sqrt((rest**2).mean()) < 1.2


def test_points_that_moved_are_so_much_nearer(part: Part, taught: Looked, truth: FloatArray) -> None:
    shift = np.array([1.6, -1.2])
    measure = taught.next(painted(mask_of(part, truth, shift))).measure(truth, COARSE)
    edges = taught.edges(truth)
    before, after = measure(edges), measure(replace(edges, points=edges.points + shift))
    np.testing.assert_allclose(after.residuals, before.residuals - edges.normals @ shift, atol=1e-9)
    assert after.loss < 0.3 * before.loss


def test_the_loss_is_half_the_weighted_squared_residual(part: Part, taught: Looked, truth: FloatArray) -> None:
    measure = taught.next(painted(mask_of(part, truth, (1.6, -1.2)))).measure(truth, COARSE)
    edges = taught.edges(truth)
    said = measure(edges)
    assert said.loss == pytest.approx(0.5 * (said.weights * said.residuals**2).mean())
    for way in np.eye(2):
        ahead, behind = (measure(replace(edges, points=edges.points + s * 1e-3 * way)).loss for s in (1.0, -1.0))
        expected = -(said.weights * said.residuals * (edges.normals @ way)).mean()
        assert (ahead - behind) / 2e-3 == pytest.approx(expected, rel=1e-4)


# ---- how much lines count ------------------------------------------------------------------------------------


def test_lines_count_little_where_colours_are_alike(part: Part, taught: Looked, truth: FloatArray) -> None:
    mask = mask_of(part, truth)
    image = painted(mask)
    left = np.arange(CAMERA.width)[None] < 200
    image[left & ~mask] = PART_COLOUR
    after = taught.next(image)
    lines = after.lines(truth)
    _, weights = lines.posterior(1, RegionLines().fade_px)
    x = lines.points[:, 0]
    assert (weights[x > 215] > 0.3).mean() > 0.8
    # A posterior without any preference.
    assert weights[x < 185].max() < 0.05


def test_unknown_or_equal_colours_have_no_say(part: Part, model: PreparedPart, truth: FloatArray) -> None:
    image = painted(mask_of(part, truth))
    unknown = looked_at(model, image, truth)
    assert unknown.memory.gate == 0.0
    assert not unknown.measure(truth, COARSE)(unknown.edges(truth)).weights.any()
    grey = looked_at(model, painted(mask_of(part, truth), PART_COLOUR, PART_COLOUR), truth)
    grey.learn(truth)
    assert grey.memory.margin == pytest.approx(0.0, abs=1e-6)
    assert grey.memory.gate == 0.0
    said = grey.measure(truth, COARSE)(grey.edges(truth))
    assert not said.weights.any()
    assert said.loss == 0.0


def test_the_margin_opens_a_gate(taught: Looked, truth: FloatArray) -> None:
    memory, edges = taught.memory, taught.edges(truth)
    assert memory.margin > 0.8
    weights = []
    for margin, gate in ((0.0, 0.0), (0.05, 0.0), (0.2, 0.5), (0.35, 1.0), (1.0, 1.0)):
        memory.margin = margin
        assert memory.gate == pytest.approx(gate)
        weights.append(taught.measure(truth, COARSE)(edges).weights)
        np.testing.assert_allclose(weights[-1], gate * taught_weights(taught, truth), atol=1e-12)
    assert weights[-1].max() > 0.5


def taught_weights(taught: Looked, truth: FloatArray) -> FloatArray:
    """(n,) with the gate wide open."""
    margin, taught.memory.margin = taught.memory.margin, 1.0
    found = taught.measure(truth, COARSE)(taught.edges(truth)).weights
    taught.memory.margin = margin
    return np.asarray(found)


def test_the_margin_is_how_well_colours_tell_inside_from_outside(
    part: Part, model: PreparedPart, taught: Looked, truth: FloatArray
) -> None:
    sure = taught.memory.config.colours.certainty
    assert taught.lines(truth).margin() == pytest.approx(2.0 * sure - 1.0, abs=0.03)
    aside = taught.next(painted(mask_of(part, truth, (6.0, 4.0))))
    assert aside.lines(truth).margin() < 0.7 * taught.lines(truth).margin()
    swapped = taught.next(painted(mask_of(part, truth), GROUND_COLOUR, PART_COLOUR))
    assert swapped.lines(truth).margin() == pytest.approx(1.0 - 2.0 * sure, abs=0.03)
    assert (
        swapped.target.bind(swapped.edges(truth), swapped.at(truth), COARSE)
        .judge(swapped.edges(truth), swapped.edges(truth), swapped.at(truth))
        .quality
        == 0.0
    )
    assert looked_at(model, painted(mask_of(part, truth)), truth).lines(truth).margin() == 0.0, "nothing is known"


def test_the_running_margin_takes_in_a_quarter_of_each_frame(part: Part, taught: Looked, truth: FloatArray) -> None:
    first = taught.memory.margin
    swapped = taught.next(painted(mask_of(part, truth), GROUND_COLOUR, PART_COLOUR))
    swapped.learn(truth, trusted=False)
    now = swapped.lines(truth).margin()
    assert taught.memory.margin == pytest.approx(first + 0.25 * (now - first), abs=0.02)


# ---- where the boundary lies beside the CAD's ------------------------------------------------------------------


def test_a_trusted_frame_measures_where_the_boundary_lies(model: PreparedPart, truth: FloatArray) -> None:
    """The real part is smaller by 0.2 mm on every side."""
    smaller = bracket(shift=(-400.0, -300.0, -500.0), inset_mm=0.2)
    looked = looked_at(model, painted(mask_of(smaller, truth)), truth)
    looked.learn(truth)
    memory, lines = looked.memory, looked.lines(truth)
    found = memory.offsets_mm[lines.ids]
    # An edge goes inwards with both its faces; of that the image shows what lies across the outline.
    edges = looked.edges(truth)
    points_cam = transform(truth, memory.edges.points_obj[lines.ids])
    across = image_directions(points_cam, lines.outward, CAMERA) @ truth[:3, :3]
    inwards = -0.2 * memory.edges.normals_obj[lines.ids].sum(1)
    expected = np.einsum("nj,nj->n", across, inwards) / lines.px_per_mm
    assert expected.max() < -0.15
    # Four fifths of it are taken over; half a pixel, in which colours are read, is a quarter of a mm.
    assert np.percentile(np.abs(found - 0.8 * expected), 95) < 0.8 * 0.35  # beyond: corners
    assert found.mean() == pytest.approx(0.8 * expected.mean(), abs=0.1)
    assert memory.known[lines.ids].all()
    np.testing.assert_array_equal(memory.mean_square[lines.ids], 0.5)
    # What was not seen is taken to lie half as far.
    unseen = np.flatnonzero(~memory.known)
    assert len(unseen) > 50
    np.testing.assert_allclose(memory.offsets_mm[unseen], 0.5 * np.median(found), atol=0.03)
    # At fine levels lines now find the outline nearly where it is expected; coarse ones look no further than colours.
    rest = {}
    for name, level in (("fine", FINE), ("coarse", COARSE)):
        said = looked.measure(truth, level)(edges)
        outward = np.einsum("nj,nj->n", lines.outward, said.directions[lines.rows])
        counts = said.weights[lines.rows] > 0.0
        rest[name] = float(np.mean((said.residuals[lines.rows] * outward)[counts]))
    px_per_mm = float(np.median(lines.px_per_mm))
    assert px_per_mm == pytest.approx(640.0 / 330.0, rel=0.1)
    assert abs(rest["fine"]) < 0.35
    assert rest["coarse"] < -0.2 * px_per_mm


def test_lines_that_were_never_steady_hardly_count_at_fine_levels(
    part: Part, model: PreparedPart, truth: FloatArray
) -> None:
    looked = looked_at(model, painted(mask_of(part, truth)), truth)
    looked.learn(truth)
    memory, edges = looked.memory, looked.edges(truth)
    ids = looked.lines(truth).ids
    config = memory.config
    crease = memory.edges.crease[edges.sample_ids]

    def fine() -> FloatArray:
        return np.asarray(looked.measure(truth, FINE)(edges).weights)

    memory.offsets_mm[:] = 0.0
    memory.mean_square[:] = 0.0
    steady = fine()
    memory.mean_square[ids] = config.scatter_px**2
    np.testing.assert_allclose(fine(), 0.5 * steady, atol=1e-12)
    memory.mean_square[ids] = config.unknown_px**2
    assert fine().max() < 0.02 * steady.max()
    # At coarse levels all lines help to find the way.
    coarse = looked.measure(truth, COARSE)(edges).weights
    assert coarse[crease].max() > 0.3


def test_lines_beside_the_image_say_nothing_of_how_steady_they_are(
    part: Part, model: PreparedPart, truth: FloatArray
) -> None:
    """Half of the part leaves the image: what is not seen there is neither unsteady nor steady."""
    looked = looked_at(model, painted(mask_of(part, truth)), truth)
    looked.learn(truth)
    for _ in range(25):
        looked.learn(truth, trusted=False)
    memory, before = looked.memory, looked.memory.mean_square.copy()
    aside, centre_cam = truth.copy(), transform(truth, part.box_centre)
    aside[0, 3] += centre_cam[2] * (CAMERA.width - CAMERA.project(centre_cam[None])[0, 0]) / CAMERA.fx
    seen = looked.solver.look(painted(mask_of(part, aside)), CAMERA, aside, 4)
    assert seen is not None
    there = Looked(looked.solver, seen)
    lines = there.lines(aside)
    outside = lines.ids[(lines.points[:, 0] > CAMERA.width) & memory.known[lines.ids]]
    assert len(outside) > 20
    assert not lines.in_image[lines.points[:, 0] > CAMERA.width].any()
    for _ in range(5):
        there.learn(aside, trusted=False)
    np.testing.assert_array_equal(memory.mean_square[outside], before[outside])


def test_later_frames_say_how_steadily_the_boundary_was_found(part: Part, taught: Looked, truth: FloatArray) -> None:
    memory = taught.memory
    ids = taught.lines(truth).ids
    offsets = memory.offsets_mm.copy()
    for _ in range(25):
        taught.learn(truth, trusted=False)
    steady = memory.mean_square[ids]
    aside = taught.next(painted(mask_of(part, truth, (2.0, 1.5))))
    for _ in range(25):
        aside.learn(truth, trusted=False)
    assert np.median(steady) < 0.5
    assert np.median(memory.mean_square[ids]) > 2.0
    # Only a trusted pose says where the boundary lies.
    np.testing.assert_array_equal(memory.offsets_mm, offsets)


def test_where_a_smooth_outline_moves_on_its_new_lines_are_believed_as_those_before() -> None:
    """A round part that turns shows other samples in each frame, none of which is seen for long."""
    part = cylinder()
    model = prepared(part)
    first = looking_at(part, np.array([1.0, 0.2, 0.3]), 330.0)
    image = painted(mask_of(part, first))
    looked = looked_at(model, image, first)
    looked.learn(first)
    memory, config = looked.memory, looked.memory.config
    smooth = ~memory.edges.crease
    assert np.median(memory.mean_square[smooth & ~memory.known]) < 0.5 * config.unknown_px**2
    assert np.median(memory.mean_square[~smooth & ~memory.known]) == config.unknown_px**2
    # Half a turn of the round part about its axis: the same image, of samples that were not seen before.
    turned = first @ axis_turn(part, 90.0)
    beside = Looked(looked.solver, looked.solver.look(image, CAMERA, turned, 4))  # type: ignore[arg-type]
    edges = beside.edges(turned)
    new = smooth[edges.sample_ids] & ~memory.known[edges.sample_ids]
    weights = np.asarray(beside.measure(turned, FINE, edges).weights)[new]
    memory.mean_square[smooth & ~memory.known] = config.unknown_px**2
    before = np.asarray(beside.measure(turned, FINE, edges).weights)[new]
    assert weights.sum() > 2.0 * before.sum() > 0.0
    # Where the same lines are seen again, what was not seen is unknown.
    looked.learn(first, trusted=False)
    assert np.median(memory.mean_square[smooth & ~memory.known]) > 0.8 * config.unknown_px**2


def axis_turn(part: Part, angle_deg: float) -> FloatArray:
    """(4, 4) about the part's z axis."""
    turn = np.eye(4)
    cosine, sine = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    turn[:2, :2] = [[cosine, -sine], [sine, cosine]]
    turn[:3, 3] = part.box_centre - turn[:3, :3] @ part.box_centre
    return turn


# ---- what the solver makes of it -----------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_regions_alone_pull_a_displaced_pose_home(
    part: Part, model: PreparedPart, truth: FloatArray, seed: int
) -> None:
    looked = looked_at(model, painted(mask_of(part, truth)), truth, REGIONS_ALONE)
    start = disturb_pose(truth, part.box_centre, 2.0, 4.0, np.random.default_rng(seed))

    def solved() -> FloatArray:
        found = looked.solver.solve(looked.seen, looked.at(start), Stopwatch())
        assert found is not None
        return found.cam_T_obj

    # Before colours are known nothing moves.
    np.testing.assert_allclose(solved(), start, atol=1e-9)
    looked.learn(truth)
    assert add_percent(part, start, truth) > 4.0
    assert add_percent(part, solved(), truth) < 2.0


def test_regions_change_no_quality_but_the_score(
    part: Part, model: PreparedPart, sequence: MadeSequence, truth: FloatArray
) -> None:
    image = painted(mask_of(part, truth))
    both, alone = looked_at(model, image, truth), looked_at(model, image, truth, WITHOUT_REGIONS)
    both.learn(truth)
    alone.learn(truth)
    found = []
    for looked in (both, alone):
        solution = looked.solver.look_at(looked.seen, looked.at(truth), FINE, Stopwatch())
        assert solution is not None
        found.append(solution)
    with_regions, without = found
    assert with_regions.quality == without.quality
    np.testing.assert_array_equal(with_regions.judgement.residuals_px, without.judgement.residuals_px)
    assert with_regions.score == pytest.approx(without.score + both.lines(truth).margin(), abs=0.02)
    # And so a tracker reports it, from the pose that it found.
    (frame,) = sequence.frames(1)
    assert isinstance(frame, Frame)
    results = [Tracker(model, method).start(frame, sequence.first_pose) for method in (ACP_REGIONS, ACP)]
    assert results[0].quality == results[1].quality > 0.7


def test_precision_at_fine_levels_is_a_share() -> None:
    config = RegionLines(precision=2.0, fine_share=0.25, fine_sigma_px=2.0)
    assert config.precision_at(Level(9, 2.1)) == 2.0
    assert config.precision_at(Level(9, 2.0)) == config.precision_at(Level(5, 1.0)) == 0.5


@pytest.mark.parametrize("margin", [(0.3, 0.3), (0.4, 0.2), (float("nan"), 0.3), (-2.0, 0.3)])
def test_a_margin_that_opens_nothing_is_refused(margin: tuple[float, float]) -> None:
    with pytest.raises(TrackingError, match=r"^targets\.margin = .*: give two rising numbers from -1 to 1$"):
        RegionLines(margin=margin)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("lines", 5),
        ("reach_px", -1.0),
        ("fine_share", -0.1),
        ("fine_sigma_px", 1e9),
        ("scatter_px", 0.0),
        ("unknown_px", -1.0),
        ("calibration_rate", 1.5),
        ("smooth_share", -1.0),
        ("fade_px", -1.0),
        ("same_view_deg", 99.0),
    ],
)
def test_settings_that_make_no_sense(name: str, value: float) -> None:
    for refused in (value, float("nan")):
        with pytest.raises(TrackingError, match=rf"^targets\.{name} = .*: give "):
            RegionLines(**{name: refused})  # type: ignore[arg-type]


# ---- how far lines are free, from frame to frame -------------------------------------------------------------


def asked(looked: Looked) -> int:
    """Of how many samples it is known."""
    return int(np.isfinite(looked.target.free.mm[0]).sum())


def test_rays_are_cast_once_until_the_part_turns(part: Part, model: PreparedPart, truth: FloatArray) -> None:
    image = painted(mask_of(part, truth))
    first = looked_at(model, image, truth)
    known = first.lines(truth)
    assert asked(first) > 50
    assert asked(first.next(image)) == 0, "a frame that taught nothing is not remembered"
    first.learn(truth)
    after = first.next(image)
    assert asked(after) >= len(known)
    np.testing.assert_allclose(after.lines(truth).free, known.free, rtol=1e-9)
    turned = move_pose(truth, part.box_centre, np.array([0.0, 0.1, 0.0, 0.0, 0.0, 0.0]))
    seen = first.solver.look(image, CAMERA, turned, 4)
    assert seen is not None
    assert asked(Looked(first.solver, seen)) == 0


def test_looking_from_elsewhere_leaves_what_is_known(part: Part, model: PreparedPart, truth: FloatArray) -> None:
    looked = looked_at(model, painted(mask_of(part, truth)), truth)
    looked.learn(truth)
    before = looked.memory.free.mm.copy()
    turned = move_pose(truth, part.box_centre, np.array([0.0, 0.02, 0.0, 0.0, 0.0, 0.0]))
    seen = looked.solver.look(looked.seen.view.image, CAMERA, turned, 4)
    assert seen is not None
    Looked(looked.solver, seen).lines(turned)
    np.testing.assert_array_equal(looked.memory.free.mm, before)


def test_a_nearer_part_has_longer_lines(part: Part, model: PreparedPart, truth: FloatArray) -> None:
    looked = looked_at(model, painted(mask_of(part, truth)), truth)
    looked.learn(truth)
    far = looked.lines(truth)
    shift = -0.2 * centre_position(truth, part.box_centre)
    nearer = move_pose(truth, part.box_centre, np.concatenate([np.zeros(3), shift]))
    after = looked.next(looked.seen.view.image)
    near = after.lines(nearer)
    both, ours, theirs = np.intersect1d(far.ids, near.ids, return_indices=True)
    assert len(both) > 30
    np.testing.assert_allclose(np.median(near.free[:, theirs] / far.free[:, ours]), 1.25, rtol=0.05)


def test_free_lengths_are_asked_for_anew_at_another_distance() -> None:
    asked = FreeLengths(np.array([0.0, 0.0, 300.0]), np.ones((2, 4)))
    assert np.isfinite(asked.seen_along(np.array([3.0, 0.0, 310.0]), 3.0).mm).all()
    for elsewhere in ([0.0, 0.0, 600.0], [0.0, 0.0, 150.0], [60.0, 0.0, 300.0]):
        assert np.isnan(asked.seen_along(np.array(elsewhere), 3.0).mm).all()
