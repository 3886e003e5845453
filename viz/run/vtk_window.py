"""Choice of a VTK window with or without a screen; VTK ends the process where it finds none, so it is tested first."""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys

from flashtemp.runs.results.current_folder import make_python_command

WINDOW_VARIABLE = "VTK_DEFAULT_OPENGL_WINDOW"
MISSING_LIBRARIES = "libegl1 libegl-mesa0 libgl1-mesa-dri (or libosmesa6 alone)"
TRIAL_CODE = "import pyvista; p = pyvista.Plotter(off_screen=True, window_size=(8, 8)); p.screenshot(return_img=True)"
WINDOW_LIBRARIES = (("libEGL.so.1", "vtkEGLRenderWindow"), ("libOSMesa.so.8", "vtkOSOpenGLRenderWindow"))


def prepare_off_screen() -> bool:
    """Choose an off-screen window before vtk is imported; False where none works."""
    if sys.platform == "linux" and WINDOW_VARIABLE not in os.environ:
        for library, window in WINDOW_LIBRARIES:
            if _can_load(library):
                os.environ[WINDOW_VARIABLE] = window
                break
    return _can_draw()


def has_screen() -> bool:
    """Whether a window can be opened here."""
    return sys.platform != "linux" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _can_load(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def _can_draw() -> bool:
    """Whether a child process, which VTK may kill, can draw a few pixels; its folder holds no settings."""
    command, env = make_python_command("-c", TRIAL_CODE)
    try:
        return subprocess.run(command, env=env, cwd=sys.prefix, capture_output=True, timeout=120).returncode == 0
    except subprocess.TimeoutExpired:
        return False
