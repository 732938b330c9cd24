"""The prepared parts of a bench: what methods need and is not there is prepared first, by whoever does the runs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from acp_lab.errors import PaintingFrameError, ParameterError, PreparationError

if TYPE_CHECKING:
    from acp_lab.bench.protocol import SequenceKey
    from acp_lab.commands.prepare import Spread
    from acp_lab.generator.painted.edge_images import PaintingFrame
    from acp_lab.tracking.method import Method

RICHEST_FIRST = ("both", "autoencoder", "templates", "")
"""Generators in the order in which they are prepared: "both" holds templates, and a part with templates alone would do
for a method that takes the best that is there."""


def places_of(root: Path, sequences: Sequence[SequenceKey], parts: Path, *, alone: bool) -> dict[SequenceKey, Path]:
    """Where the prepared part of each sequence of a data set is, or is to be.

    That is parts/DATASET. Only where no other data set is benched, and it is not there, it may lie in `parts` itself,
    as `acp-lab prepare` leaves it, prepared from the same mesh.
    """
    from acp_lab.preparation import check_same_mesh
    from acp_lab.prepared_part import part_folder
    from acp_lab.sequences.bop import BopDataset

    def place(key: SequenceKey) -> Path:
        own, mesh = parts / key.dataset, BopDataset(root).part_path(key.object_id)
        if not alone or part_folder(own, mesh.stem).exists() or not part_folder(parts, mesh.stem).exists():
            return own
        try:
            check_same_mesh(BopDataset(root).part(key.object_id), part_folder(parts, mesh.stem))
        except PreparationError:
            return own
        return parts

    by_object = {key.object_id: place(key) for key in {key.object_id: key for key in sequences}.values()}
    return {key: by_object[key.object_id] for key in sequences}


def prepare_missing(
    root: Path, split: str, parts: Path, sequences: Sequence[SequenceKey], methods: Sequence[Method | str],
    spread: Spread,
) -> None:  # fmt: skip
    """Prepare what the methods need of a data set's parts, and a folder lacks, into it.

    Raises:
        PreparationError: what is missing is no part, such as the environment of cv2.rapid; or the folder holds a part
            of another mesh or unit.
    """
    from acp_lab.commands.prepare import prepare_parts
    from acp_lab.prepared_part import PrepareOptions

    for generator in sorted({generator_of(method) for method in methods}, key=RICHEST_FIRST.index):
        own = [method for method in methods if generator_of(method) == generator]
        meshes = list(_lacking(root, split, parts, sequences, own, generator))
        if not meshes:
            continue
        names = meshes[0].name if len(meshes) == 1 else f"{len(meshes)} parts"
        print(f"Preparing {names} ({generator}), which {parts} lacks: once, then kept ...", flush=True)
        frame = next(iter(painting_frames(own)), PrepareOptions.painting_frame)
        options = PrepareOptions(generator=generator, painting_frame=frame)
        try:
            prepare_parts(meshes, parts, options, spread=spread)
        except PreparationError as error:  # it speaks of options that a bench does not have
            raise PreparationError(f"{error} (options of acp-lab prepare; or give bench another --parts)") from None


def check_painting(methods: Sequence[Method | str]) -> None:
    """ParameterError for methods whose parts cannot be prepared for all of them."""
    if len(painting_frames(methods)) > 1:
        raise ParameterError(
            "--methods: some need auto-encoders that paint in different frames, and a part holds one: compare them in "
            "two benches, with --parts of their own"
        )


def painting_frames(methods: Sequence[Method | str]) -> set[PaintingFrame]:
    """In which frames auto-encoders must paint; for methods that take any, none."""
    from acp_lab.tracking.sources.painted import PaintedRidges

    sources = [method.source for method in methods if not isinstance(method, str)]
    return {source.frame for source in sources if isinstance(source, PaintedRidges)}


def generator_of(method: Method | str) -> str:
    """What a part must be prepared with; "" for nothing."""
    from acp_lab.tracking.sources.rigid import CadSamples

    if isinstance(method, str):
        return ""
    if isinstance(method.source, CadSamples):
        return "templates" if method.source.generator == "templates" else "both"
    return "autoencoder"


def _lacking(
    root: Path, split: str, parts: Path, sequences: Sequence[SequenceKey], methods: Sequence[Method | str],
    generator: str,
) -> Iterator[Path]:  # fmt: skip
    """The meshes of parts that lack what some of the methods, all of one generator, need."""
    from acp_lab.bench.protocol import Variant, task_of
    from acp_lab.bench.runner import check
    from acp_lab.sequences.bop import BopDataset

    for key in {key.object_id: key for key in reversed(sequences)}.values():
        try:
            for method in methods:
                check(task_of(root, split, parts, key, method, Variant()))
        except PaintingFrameError as error:
            # What is there took minutes to train, and other methods need it.
            raise ParameterError(f"--parts {parts}: {error}; or give another --parts") from None
        except PreparationError:
            if not generator:
                raise
            yield BopDataset(root).part_path(key.object_id)
