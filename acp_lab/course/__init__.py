"""What the notebooks need besides the package: the sample made ready, and a grader for their exercises.

    from acp_lab import course

    course.start()                                # one look for all pictures, one thread
    scene, model = course.sample_scene(), course.sample_model()
    course.check("01.1", answer)                  # right, or a sentence that helps

The graders of notebook NN live in `acp_lab.course.lesson_NN`; its exercises are called "NN.1", "NN.2" ...
"""

from __future__ import annotations

from acp_lab.course.answers import Hint
from acp_lab.course.grader import CourseError, Verdict, check, exercise, exercises
from acp_lab.course.workshop import SAMPLE_REGION, files_folder, sample_model, sample_part, sample_scene, start

__all__ = [
    "SAMPLE_REGION",
    "CourseError",
    "Hint",
    "Verdict",
    "check",
    "exercise",
    "exercises",
    "files_folder",
    "sample_model",
    "sample_part",
    "sample_scene",
    "start",
]
