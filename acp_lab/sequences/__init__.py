"""Where frames come from, and the files that tell their poses."""

from __future__ import annotations

from acp_lab.sequences.bop import BopDataset, BopScene, open_sequence
from acp_lab.sequences.frame import Frame, UnreadableFrame
from acp_lab.sequences.images import CameraDevice, ImageFolder, VideoFile, open_images
from acp_lab.sequences.json_file import read_pose, write_pose
from acp_lab.sequences.pixel_coding import PixelCoding
from acp_lab.sequences.protocol import Sequence
from acp_lab.sequences.results_csv import ResultRow, ResultsWriter, first_start, read_results, start_poses, start_rows

__all__ = [
    "BopDataset",
    "BopScene",
    "CameraDevice",
    "Frame",
    "ImageFolder",
    "PixelCoding",
    "ResultRow",
    "ResultsWriter",
    "Sequence",
    "UnreadableFrame",
    "VideoFile",
    "first_start",
    "open_images",
    "open_sequence",
    "read_pose",
    "read_results",
    "start_poses",
    "start_rows",
    "write_pose",
]
