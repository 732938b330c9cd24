"""models_info.json: what it says arrives, and what is wrong with it is said in one line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from acp_lab.cad.models_info import Symmetries, read_models_info
from acp_lab.errors import InputFileError

ENTRY: dict[str, Any] = {
    "diameter": 92.5,
    "min_x": -38.0,
    "min_y": -27.0,
    "min_z": -12.0,
    "size_x": 76.0,
    "size_y": 54.0,
    "size_z": 24.0,
}
HALF_TURN = [-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]


def _write(folder: Path, content: Any) -> Path:
    path = folder / "models_info.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
    return path


def test_entries_are_read(tmp_path: Path) -> None:
    axis = {"axis": [0, 0, 2], "offset": [1, 0, 0]}
    turned = {**ENTRY, "symmetries_discrete": [HALF_TURN], "symmetries_continuous": [axis]}
    infos = read_models_info(_write(tmp_path, {"1": ENTRY, "000012": turned}))
    assert list(infos) == [1, 12]
    assert infos[1].diameter == 92.5
    np.testing.assert_array_equal(infos[1].box_min, [-38.0, -27.0, -12.0])
    np.testing.assert_array_equal(infos[1].box_max, [38.0, 27.0, 12.0])
    assert not infos[1].symmetries
    assert infos[1].source == tmp_path / "models_info.json"
    assert infos[12].symmetries
    assert infos[12].symmetries.discrete.shape == (1, 4, 4)
    assert infos[12].symmetries.continuous == (((0.0, 0.0, 2.0), (1.0, 0.0, 0.0)),)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "file is empty.*one entry per object"),
        ('{"1": {', "not valid JSON"),
        ("[" * 100_000, "not valid JSON"),
        ("[]", "one entry per object"),
        ("{}", "one entry per object"),
        ({"bolt": ENTRY}, "key 'bolt' is no object id"),
        ({"1": 92.5}, "object 1: must be a JSON object"),
        ({"1": {**ENTRY, "diameter": None}}, "object 1: diameter is None"),
        ({"1": {**ENTRY, "diameter": "92"}}, "object 1: diameter is 92: give a finite number"),
        ({"1": {**ENTRY, "diameter": True}}, "object 1: diameter is True"),
        ({"1": {**ENTRY, "diameter": float("nan")}}, "object 1: diameter is nan"),
        ({"1": {**ENTRY, "diameter": 10**400}}, "object 1: diameter is 1000"),
        ({"1": {**ENTRY, "min_x": -(10**400)}}, "object 1: min_x is -1000"),
        ({"1": {**ENTRY, "size_x": 1e300}}, "object 1: size_x is"),
        ({"1" * 5000: ENTRY}, "is no object id"),
        ({"²": ENTRY}, "is no object id"),
        ({"1": {**ENTRY, "symmetries_discrete": [[10**400] * 16]}}, "symmetries_discrete must be"),
        ({"1": {**ENTRY, "symmetries_discrete": [[*HALF_TURN[:3], 1e300, *HALF_TURN[4:]]]}}, "no rigid transform"),
        ({"1": {**ENTRY, "symmetries_continuous": [{"axis": [0, 0, 10**400], "offset": [0] * 3}]}}, "must be"),
        ({"1": {**ENTRY, "symmetries_continuous": [{"axis": [0, 0, 1e-300], "offset": [0] * 3}]}}, "not 0"),
        ({"1": {**ENTRY, "diameter": 0}}, "object 1: diameter is 0: it must be above"),
        ({"1": {**ENTRY, "size_y": -1}}, "cannot be negative"),
        ({"1": {key: ENTRY[key] for key in ENTRY if key != "min_z"}}, "object 1: min_z is missing"),
        ({"1": {**ENTRY, "symmetries_discrete": [[1, 2]]}}, "symmetries_discrete must be"),
        ({"1": {**ENTRY, "symmetries_discrete": [[2 * v for v in HALF_TURN]]}}, "no rigid transform"),
        ({"1": {**ENTRY, "symmetries_discrete": [[*HALF_TURN[:12], 10, 20, 30, 1]]}}, "the last one 0, 0, 0"),
        ({"1": {**ENTRY, "symmetries_discrete": [[*HALF_TURN[:15], 0]]}}, "no rigid transform"),
        ({"1": {**ENTRY, "symmetries_discrete": [[float("nan"), *HALF_TURN[1:]]]}}, "no rigid transform"),
        ({"1": {**ENTRY, "symmetries_continuous": {"axis": [0, 0, 1]}}}, "symmetries_continuous must be"),
        ({"1": {**ENTRY, "symmetries_continuous": [{"axis": [0, 0, 1]}]}}, "symmetries_continuous must be"),
        ({"1": {**ENTRY, "symmetries_continuous": [{"axis": [0, 0], "offset": [0, 0, 0]}]}}, "must be"),
        ({"1": {**ENTRY, "symmetries_continuous": [{"axis": [0, 0, 0], "offset": [0, 0, 0]}]}}, "not 0"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(content: Any, message: str, tmp_path: Path) -> None:
    path = _write(tmp_path, content)
    with pytest.raises(InputFileError, match=message) as caught:
        read_models_info(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_missing_and_unreadable_files(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match="no such file"):
        read_models_info(tmp_path / "models_info.json")
    with pytest.raises(InputFileError, match="cannot be read"):
        read_models_info(tmp_path)
    (tmp_path / "binary.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputFileError, match="UTF-8"):
        read_models_info(tmp_path / "binary.json")


def test_no_symmetry_is_the_identity_alone() -> None:
    none = Symmetries.none()
    assert not none
    assert not none.any
    np.testing.assert_array_equal(none.transforms(), np.eye(4)[None])


def test_transforms_hold_the_identity_once_and_first() -> None:
    half_turn = np.array(HALF_TURN, dtype=float).reshape(4, 4)
    symmetries = Symmetries(np.array([np.eye(4), half_turn]))
    np.testing.assert_array_equal(symmetries.transforms(), [np.eye(4), half_turn])


def test_a_continuous_axis_is_cut_into_equal_turns_about_its_line() -> None:
    symmetries = Symmetries(np.zeros((0, 4, 4)), (((0.0, 3.0, 0.0), (7.0, 1.0, -2.0)),))
    turns = symmetries.transforms(steps=8)
    assert turns.shape == (8, 4, 4)
    np.testing.assert_array_equal(turns[0], np.eye(4))
    on_axis = np.array([[7.0, 5.0, -2.0, 1.0], [7.0, -40.0, -2.0, 1.0]])
    np.testing.assert_allclose(turns @ on_axis.T, np.broadcast_to(on_axis.T, (8, 4, 2)), atol=1e-12)
    angles = np.degrees(np.arccos((np.trace(turns[:, :3, :3], axis1=1, axis2=2) - 1.0) / 2.0))
    np.testing.assert_allclose(angles, [0, 45, 90, 135, 180, 135, 90, 45], atol=1e-6)
    # Turns of one step follow each other: the set is closed.
    np.testing.assert_allclose(turns[1] @ turns[1], turns[2], atol=1e-12)


def test_discrete_and_continuous_are_combined() -> None:
    flip = np.diag([1.0, -1.0, -1.0, 1.0])
    symmetries = Symmetries(flip[None], (((0.0, 0.0, 1.0), (0.0, 0.0, 0.0)),))
    transforms = symmetries.transforms(steps=6)
    assert transforms.shape == (12, 4, 4)
    # A cylinder about z stays itself under each of them.
    rim = np.array([[np.cos(a), np.sin(a), z, 1.0] for a in np.radians(range(0, 360, 60)) for z in (-1, 1)])
    for transform in transforms:
        moved = rim @ transform.T
        nearest = np.linalg.norm(moved[:, None] - rim, axis=2).min(axis=1)
        assert nearest.max() < 1e-12
    with pytest.raises(ValueError, match="at least 1"):
        symmetries.transforms(steps=0)
