"""What is compared: a task is one method on one object of one scene, from one start, with one frame step.

The first frame is the scene's lowest image id; a tracker gets its true pose there, or that pose disturbed by a known
amount, and never a later truth, except where resets are on: then a part whose ADD exceeded 30% of the diameter is
started again from the truth of that frame.
"""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import asdict, dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import acp_lab
from acp_lab.bench.touched import model_look, scene_look
from acp_lab.errors import ParameterError
from acp_lab.prepared_part import part_folder
from acp_lab.sample import sample_dataset
from acp_lab.sequences.bop import BopDataset
from acp_lab.tracking.method import Method
from acp_lab.tracking.method_file import method_from_toml, to_toml

LARGEST_STEP = 100
_READABLE = 120
_SOURCES = (
    "bench/runner.py", "bench/rapid", "cad", "compiled.py", "control_points", "detection", "evaluation", "generator",
    "geometry", "imaging", "input_file.py", "prepared_part", "sequences", "tracking",
)  # fmt: skip


@dataclass(frozen=True)
class Variant:
    """How a sequence is run.

    Attributes:
        step: every step-th frame is used.
        noise_deg, noise_mm: how far the start pose is off, exactly; seed: in which direction.
        resets: whether a lost part is started again from the truth.

    Raises:
        ParameterError: a number that makes no sense.
    """

    step: int = 1
    noise_deg: float = 0.0
    noise_mm: float = 0.0
    seed: int = 0
    resets: bool = False

    def __post_init__(self) -> None:
        if not 1 <= self.step <= LARGEST_STEP:
            raise ParameterError(f"--steps {self.step}: give 1 to {LARGEST_STEP}: 2 is every second frame")
        if not (0.0 <= self.noise_deg <= 180.0 and 0.0 <= self.noise_mm < 1e6):
            raise ParameterError(f"--noise {self.noise_deg:g},{self.noise_mm:g}: give degrees up to 180, and mm")

    @property
    def start(self) -> str:
        """Of the start alone: "truth", or "2°, 2 mm off"."""
        disturbed = self.noise_deg or self.noise_mm
        return f"{self.noise_deg:g}°, {self.noise_mm:g} mm off" if disturbed else "truth"

    @property
    def group(self) -> tuple[int, float, float, bool]:
        """What runs of several seeds share."""
        return self.step, self.noise_deg, self.noise_mm, self.resets

    def __str__(self) -> str:
        frames = "every frame" if self.step == 1 else f"1 of {self.step} frames"
        return f"{frames}, from {self.start}" + (", resets" if self.resets else "")


@dataclass(frozen=True)
class Task:
    """One run to be done, in plain values, so that any process can be handed it as JSON.

    Attributes:
        dataset: root of a data set in the BOP layout; split: its folder of scenes; parts: its prepared parts.
        scene_id, object_id: what is tracked; instance: which of several in the scene, counted in its first frame.
        method_name: what results are called; method: all its settings, as TOML; "" for one of cv2.rapid.
        variant: how.
    """

    dataset: str
    split: str
    parts: str
    scene_id: int
    object_id: int
    instance: int
    method_name: str
    method: str
    variant: Variant = field(default_factory=Variant)

    @property
    def sequence(self) -> SequenceKey:
        """What is tracked, without how."""
        return SequenceKey(dataset_name(Path(self.dataset)), self.scene_id, self.object_id, self.instance)

    @property
    def file_name(self) -> str:
        """Of the run, readable, and another one for every task of a bench."""
        how = self.variant
        noise = f"-{how.noise_deg:g}deg{how.noise_mm:g}mm-seed{how.seed}" if how.start != "truth" else ""
        resets = "-resets" if how.resets else ""
        words = [str(self.sequence).replace("/", "-"), self.method_name, f"step{how.step}{noise}{resets}"]
        readable = re.sub(r"[^\w.-]", "_", "--".join(words))[:_READABLE]
        # "a b" and "a_b", or part 2 of "a-1" and instance 2 of part 1 of "a", read the same.
        exact = hashlib.sha256(repr((self.sequence, self.method_name, how)).encode(errors="surrogateescape"))
        return f"{readable}--{exact.hexdigest()[:8]}.json"

    def settings(self) -> Method:
        """The method, for a task that has settings; InputFileError where they are none."""
        return method_from_toml(self.method, f"method {self.method_name}")

    @property
    def state(self) -> str:
        """Changes with the method's settings, the data and its place, the prepared part and the sources of runs."""
        part = self.part_header if self.method else ""
        looks = self.scene_look, self.model_look
        return digest(self.method, str(Path(self.dataset).resolve()), self.split, part, *looks)

    @property
    def scene_look(self) -> str:
        """Changes with the files of the scene, see `touched`; InputFileError or SequenceError where there are none."""
        return scene_look(BopDataset(self.dataset), self.scene_id, self.split)

    @property
    def model_look(self) -> str:
        """Changes with the files of the object's model, see `touched`; SequenceError where there is none."""
        return model_look(BopDataset(self.dataset), self.object_id)

    @property
    def part_header(self) -> str:
        """The text of the prepared part's part.json, which holds the checksums of all its files; "" where none is."""
        mesh = BopDataset(self.dataset).part_path(self.object_id)
        header = part_folder(Path(self.parts), mesh.stem, mesh) / "part.json"
        return header.read_text(encoding="utf-8") if header.exists() else ""

    def to_json(self) -> str:
        """The task as text."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> Task:
        """The inverse of `to_json`."""
        values: dict[str, Any] = json.loads(text)
        return cls(**{**values, "variant": Variant(**values["variant"])})


@dataclass(frozen=True, order=True)
class SequenceKey:
    """One object through one scene: what methods are paired by.

    Prints as "data/1/2", a second instance as "data/1/2/1".
    """

    dataset: str
    scene_id: int
    object_id: int
    instance: int = 0

    def __str__(self) -> str:
        instance = f"/{self.instance}" if self.instance else ""
        return f"{self.dataset}/{self.scene_id}/{self.object_id}{instance}"


def dataset_name(root: Path) -> str:
    """The name of a data set's folder; "sample" for the one that comes with the package."""
    root = root.resolve()
    return "sample" if root == Path(sample_dataset()).resolve() else root.name


def task_of(
    dataset: Path, split: str, parts: Path, sequence: SequenceKey, method: Method | str, variant: Variant
) -> Task:
    """The task of a method, or of a tracker of cv2.rapid by its name, on a sequence of a data set."""
    ids = sequence.scene_id, sequence.object_id, sequence.instance
    told = (method, "") if isinstance(method, str) else (method.name, to_toml(method))
    return Task(str(dataset.resolve()), split, str(parts.resolve()), *ids, *told, variant)


def digest(*words: str) -> str:
    """Ten letters that change with the words and with the sources that make runs."""
    return hashlib.sha256("\0".join((_sources(), *words)).encode()).hexdigest()[:10]


@lru_cache(maxsize=1)
def _sources() -> str:
    package = Path(acp_lab.__file__).parent
    files = [package / name for name in _SOURCES if name.endswith(".py")]
    # What networks have learnt decides as much as what is written around them.
    kinds = ("*.py", "*.safetensors")
    files += sorted(path for name in _SOURCES for kind in kinds for path in (package / name).rglob(kind))
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()
