"""`acp-lab doctor`: what works on this machine, one line per check, and the fix for what does not.

Three verdicts: `ok`; `absent` for something that only part of the toolkit wants; `BROKEN` for what everything
needs. Each check is a small function that returns a `Check` and never raises.
"""

from __future__ import annotations

import importlib
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from importlib import metadata
from pathlib import Path

import acp_lab
from acp_lab.commands import machine
from acp_lab.commands.installation import checkout, install_extra
from acp_lab.commands.replay import has_display
from acp_lab.commands.replay_web import without_telemetry

_MODULES = {
    "opencv-python-headless": "cv2",
    "rerun-sdk": "rerun",
    "pyrender": "",  # its import needs OpenGL, which has a check of its own
    "embreex": "",  # likewise
}
_PIP = "python -m pip install"
_GL_TRIAL = (
    "from acp_lab.cad.part import Part; from acp_lab.cad.shading import shade; "
    "from acp_lab.geometry.camera import Camera; import numpy as np; "
    "part = Part.from_mesh([[0, 0, 0], [20, 0, 0], [0, 20, 0], [0, 0, 20]],"
    " [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], 'trial'); "
    "pose = np.eye(4); pose[2, 3] = 100; shade(part, Camera(32, 32, 30, 30, 15.5, 15.5), pose)"
)


class Verdict(StrEnum):
    """How a check came out."""

    OK = "ok"
    ABSENT = "absent"
    BROKEN = "BROKEN"


@dataclass(frozen=True)
class Check:
    """One line of the report; fix says what to do, empty when there is nothing to do."""

    verdict: Verdict
    what: str
    fix: str = ""

    def __str__(self) -> str:
        return f"{self.verdict:<7} {self.what}" + (f": {self.fix}" if self.fix else "")


def checks() -> Iterator[Check]:
    """All checks, in the order in which a newcomer's machine fails them."""
    yield check_python()
    broken = []
    for found in check_packages():
        yield found
        if found.verdict is Verdict.BROKEN:
            broken.append(found)
    for check in checks_of_machine():
        yield _safely(check, broken)


def checks_of_machine() -> tuple[Callable[[], Check], ...]:
    """What is tried out, after the packages."""
    return (
        check_ray_casting,
        check_sample,
        check_writing,
        check_compiled,
        check_viewer,
        check_opengl,
        check_step,
        check_notebook_viewer,
        *([check_chromium] if checkout() else []),  # only the tests of a checkout want it
    )


def print_report() -> int:
    """Print one line per check as it is done; 0 unless something that is needed is broken, then 1."""
    broken = 0
    for check in checks():
        print(" ".join(str(check).split("\n")), flush=True)
        broken += check.verdict is Verdict.BROKEN
    print(f"{broken} broken: fix these first" if broken else "everything needed works")
    return 1 if broken else 0


def check_python() -> Check:
    """Python and the processor; pip refuses Pythons that are too old."""
    what = (
        f"Python {platform.python_version()} on {platform.platform()}, {machine.cores()} cores of {machine.cpu_model()}"
    )
    return Check(Verdict.OK, what)


def check_packages() -> Iterator[Check]:
    """Every package that acp_lab requires: there, in the range, and it can be imported."""
    try:
        requirements = metadata.requires("acp_lab") or []
    except metadata.PackageNotFoundError:
        fix = f"{_PIP} -e . in the checkout"
        yield Check(Verdict.ABSENT, "acp_lab runs from its source and is not installed", fix)
        return
    for text in requirements:
        check = _check_requirement(text)
        if check is not None:
            yield check


def _check_requirement(text: str) -> Check | None:
    from packaging.requirements import Requirement

    requirement = Requirement(text)
    if requirement.marker is not None and not requirement.marker.evaluate({"extra": ""}):
        return None
    name, fix = requirement.name, f'{_PIP} "{requirement.name}{requirement.specifier}"'
    try:
        found = metadata.version(name)
    except metadata.PackageNotFoundError:
        return Check(Verdict.BROKEN, f"{name} is not installed", fix)
    if not requirement.specifier.contains(found, prereleases=True):
        return Check(Verdict.BROKEN, f"{name} {found} is outside {requirement.specifier}", fix)
    module = _MODULES.get(name, name.replace("-", "_"))
    try:
        if module:
            importlib.import_module(module)
    except Exception as error:
        return Check(
            Verdict.BROKEN,
            f"{name} {found} cannot be imported ({_short(error)})",
            f"{fix} --force-reinstall",
        )
    return Check(Verdict.OK, f"{name} {found}")


def check_ray_casting() -> Check:
    """Embree: what makes visibility fast."""
    import numpy as np

    from acp_lab.cad.raycast import EmbreeCaster

    try:
        caster = EmbreeCaster(np.eye(3), np.array([[0, 1, 2]]))
        distance, _ = caster.first_hit(np.array([[0.0, 0.0, 0.0]]), np.array([[1.0, 1.0, 1.0]]))
    except Exception as error:
        fix = f"{_PIP} embreex; without it rays are cast in NumPy, which is slow but right"
        return Check(Verdict.ABSENT, f"ray casting with Embree ({_short(error)})", fix)
    if abs(distance[0] - 1.0 / 3.0) > 1e-5:
        return Check(Verdict.BROKEN, f"Embree hits at {distance[0]:g}, not 1/3", f"{_PIP} --force-reinstall embreex")
    return Check(Verdict.OK, "ray casting with Embree")


def check_sample() -> Check:
    """The part and the sequence that `acp-lab demo` works on."""
    from acp_lab.commands.demo import open_sample
    from acp_lab.errors import AcpLabError
    from acp_lab.sequences.frame import UnreadableFrame

    fix = (
        "check out acp_lab/sample again" if checkout() else "install the wheel again, with --force-reinstall --no-deps"
    )
    try:
        scene = open_sample()
        unreadable = [frame for frame in scene.frames() if isinstance(frame, UnreadableFrame)]
        for object_id in scene.object_ids:
            scene.dataset.part(object_id)
    except AcpLabError as error:
        return Check(Verdict.BROKEN, f"sample ({_short(error)})", fix)
    if unreadable:
        return Check(Verdict.BROKEN, f"sample ({unreadable[0].reason})", fix)
    return Check(Verdict.OK, f"sample: {len(scene.frame_ids)} images and the parts that they show")


def check_writing() -> Check:
    """Whether results can be written here."""
    for folder in (Path.cwd(), Path(tempfile.gettempdir())):
        try:
            with tempfile.TemporaryFile(dir=folder) as trial:
                trial.write(b"trial")
        except OSError as error:
            fix = "change to a folder of your own, or name one with --out"
            return Check(Verdict.BROKEN, f"{folder} cannot be written ({error.strerror})", fix)
    free = shutil.disk_usage(Path.cwd()).free / 1e9
    return Check(Verdict.OK, f"{Path.cwd()} can be written, {free:.1f} GB free")


def check_compiled() -> Check:
    """Whether the machine code of a first start is there at the next one."""
    from acp_lab.compiled import HOW_TO_KEEP, NOT_KEPT, can_be_kept

    if can_be_kept():
        return Check(Verdict.OK, "compiled code can be kept")
    return Check(Verdict.ABSENT, NOT_KEPT, HOW_TO_KEEP)


def check_viewer() -> Check:
    """The rerun viewer behind `acp-lab replay`."""
    done = _run([sys.executable, "-m", "rerun", "--version"], 30, without_telemetry())
    if done.returncode != 0:
        fix = f"{_PIP} rerun-sdk --force-reinstall; if it hangs, rerun analytics disable"
        return Check(Verdict.ABSENT, "the replay viewer does not start", fix)
    version = done.stdout.split("(")[0].strip() or "rerun"
    if not has_display():
        return Check(Verdict.OK, f"{version}; without a display, acp-lab replay shows replays in a browser")
    return Check(Verdict.OK, f"{version}, opened by acp-lab replay")


def check_opengl() -> Check:
    """Software or hardware OpenGL for shaded pictures; in a process of its own, drivers may crash."""
    environment = dict(os.environ)
    if sys.platform.startswith("linux"):
        environment.setdefault("PYOPENGL_PLATFORM", "egl")
    done = _run([sys.executable, "-c", _GL_TRIAL], 60, environment)
    if done.returncode == 0:
        return Check(Verdict.OK, "OpenGL draws shaded pictures of parts")
    reason = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
    fix = "only shaded pictures need it; on Debian and Ubuntu apt-get install libegl1 libgl1-mesa-dri"
    return Check(Verdict.ABSENT, f"OpenGL ({reason[:100]})", fix)


def check_step() -> Check:
    """Reading STEP files."""
    return _optional("cascadio", "STEP files can be read", f"{install_extra('step')}, to read STEP files")


def check_notebook_viewer() -> Check:
    """Replays inside notebooks."""
    fix = f"{install_extra('notebook')}, to see replays inside notebooks"
    return _optional("rerun_notebook", "replays show inside notebooks", fix)


def check_chromium() -> Check:
    """The browser that the tests of notebooks' widgets drive."""
    for name in ("chromium", "chromium-browser", "google-chrome"):
        found = shutil.which(name)
        if found:
            return Check(Verdict.OK, f"{found} for the browser tests")
    return Check(Verdict.ABSENT, "Chromium", "only browser tests want it; on Debian apt-get install chromium")


def _optional(module: str, what: str, fix: str) -> Check:
    try:
        importlib.import_module(module)
    except Exception as error:
        if isinstance(error, ModuleNotFoundError) and error.name == module:
            return Check(Verdict.ABSENT, module, fix)
        again = f"python -m pip uninstall {module}, then {fix}"
        return Check(Verdict.ABSENT, f"{module} is installed, but cannot be imported ({_short(error)})", again)
    return Check(Verdict.OK, what)


def _safely(check: Callable[[], Check], broken: Sequence[Check] = ()) -> Check:
    """What a check says; one that fails for a package that is `broken`, as a line above tells, is no second fault."""
    try:
        return check()
    except Exception as error:
        named = next((one for one in broken if isinstance(error, ImportError) and _is_told(error, one)), None)
        if named is not None:
            return Check(Verdict.ABSENT, f"{check.__name__} cannot be tried", f"see {named.what.split()[0]} above")
        fix = "report this, with the whole output of acp-lab doctor"
        return Check(Verdict.BROKEN, f"{check.__name__} ({type(error).__name__}: {_short(error)})", fix)


def _is_told(error: ImportError, broken: Check) -> bool:
    """Whether the line of a broken package names the package that cannot be imported, or gives that very reason."""
    module = (error.name or "").partition(".")[0]
    package = next((name for name, its in _MODULES.items() if its == module), module.replace("_", "-"))
    return broken.what.split()[0] == package or f"({_short(error)})" in broken.what


def _run(
    command: list[str], timeout_s: float, environment: dict[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    """Run a program with its output kept; status 124 when it takes too long."""
    # The package may run from a checkout that is not installed.
    environment = dict(os.environ if environment is None else environment)
    home = str(Path(acp_lab.__file__).parent.parent)
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, [home, environment.get("PYTHONPATH")]))
    try:
        return subprocess.run(
            command,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=timeout_s,
            check=False,
            env=environment,
            stdin=subprocess.DEVNULL,
        )
    except subprocess.TimeoutExpired:
        return subprocess.CompletedProcess(command, 124, "", f"no answer within {timeout_s:g} s")


def _short(error: BaseException) -> str:
    return " ".join(str(error).split())[:160] or type(error).__name__
