"""Scenes as JSON, for other programs, and as the viewer: one HTML page that needs no other file and no network.

In JSON, positions are 16-bit integer counts of a step, about a tenth of a millimetre, in base64; see
docs/recordings-reference.md. The parts of the page are in the folder ``viewer``: its style, six scripts, and the
library three.js with its licence. `page.html` joins them.
"""

import base64
import hashlib
import html
import json
from pathlib import Path

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from study.arrays import Floats
from study.recordings.recording import written
from study.recordings.skeleton.scene import Scene
from study.recordings.view import figure
from study.recordings.view.figure import LEVEL, exaggeration, half_axes
from study.style import save_bytes

FORMAT = "sphere-fit-study motion"
VERSION = 1
MISSING = -32768
"""The count of an unknown coordinate."""
_LARGEST = 32767
_RATE = 60.0
"""Largest number of frames per second; screens show no more."""


def motion_document(scene: Scene, rate: float = _RATE) -> dict[str, object]:
    """The document that JSON stores for a scene.

    Args:
        scene: the motion.
        rate: largest number of frames per second; a faster motion keeps every second, third, ... frame.

    Returns:
        Names, numbers and lists. The arrays are in base64, 16-bit integers with the low byte first: ``markers``
        (frames, markers, 3) and ``points`` (frames, joints and tips, 3) in steps from ``origin``, -32768 if unknown;
        ``turns`` (frames, joints, 4), quaternions x, y, z, w times 32767 that rotate an ellipsoid's axes to the
        world's; ``axes``, the same for the anatomical axes of the segments that move about the joints, if any has
        some; ``root_axes``, the same for the segments without a joint above, in the middle of the joints whose numbers
        ``roots`` has; and ``flags`` (frames, joints) in bytes, as `Flag`.
    """
    shown = scene.at_most(rate)
    places = np.concatenate([shown.places, shown.points])
    along = places.transpose(1, 0, 2).reshape(3, -1)
    low, high = np.nanmin(along, axis=1), np.nanmax(along, axis=1)
    origin = 0.5 * (low + high)
    step = max(float((high - low).max()) / (2 * _LARGEST), 1e-6)
    counts = _rounded((places - origin[:, None]) / step).transpose(2, 0, 1)
    half = np.where(np.isnan(shown.errors), np.nan, half_axes(shown))
    turns, count = _rounded(_LARGEST * shown.anatomy).transpose(1, 0, 2), len(shown.joints)
    axes = {"axes": turns[:, :count], "root_axes": turns[:, count:]}
    columns = shown.joints, shown.doubts, map(_numbers, shown.errors), map(_numbers, half)
    names = "name", "doubt", "errors", "half_axes"
    joints = [dict(zip(names, joint, strict=True)) for joint in zip(*columns, strict=True)]
    arrays = {
        "markers": _base64(counts[:, : len(shown.markers)]),
        "points": _base64(counts[:, len(shown.markers) :]),
        "turns": _base64(_rounded(_LARGEST * shown.orientations).transpose(1, 0, 2)),
        "flags": base64.b64encode(np.ascontiguousarray(shown.flags.T).tobytes()).decode(),
        **{name: _base64(part) for name, part in axes.items() if (part != MISSING).any()},
    }
    document: dict[str, object] = {"format": FORMAT, "version": VERSION, "name": shown.name, "source": shown.source}
    document |= {"notes": list(shown.notes), "rate": shown.rate, "frames": shown.frames, "unit": "m", "up": "z"}
    document |= {"floor": round(shown.floor, 4), "markers": list(shown.markers), "joints": joints}
    document |= {"tips": list(shown.tips), "sides": list(shown.sides()), "bones": list(map(list, shown.bones))}
    document |= {"roots": list(map(list, shown.roots)), "level": LEVEL, "exaggeration": exaggeration(shown)}
    return document | {"step": step, "origin": [round(float(x), 6) for x in origin], "arrays": arrays}


def motion_text(scene: Scene, rate: float = _RATE) -> str:
    """A scene as JSON text; see `motion_document`."""
    return json.dumps(motion_document(scene, rate), ensure_ascii=False, allow_nan=False, separators=(",", ":"))


def write_motion(scene: Scene, path: str | Path) -> Path:
    """Write a scene as JSON, for the viewer to open.

    Raises:
        RecordingError: if it cannot be written.
    """
    return written(Path(path), lambda temporary: temporary.write_bytes(motion_text(scene).encode()))


def _rounded(numbers: Floats) -> "np.typing.NDArray[np.int16]":
    """Numbers rounded to 16-bit integers; `MISSING` for NaN."""
    rounded = np.clip(np.rint(numbers), -_LARGEST, _LARGEST)
    return np.where(np.isnan(rounded), MISSING, rounded).astype("<i2")


def _base64(counts: "np.typing.NDArray[np.int16]") -> str:
    return base64.b64encode(np.ascontiguousarray(counts).tobytes()).decode()


def _numbers(row: Floats) -> list[float | None]:
    """Lengths rounded to a micrometre, metres; None for NaN."""
    return [None if np.isnan(x) else round(float(x), 6) for x in row]


_FOLDER = Path(__file__).parent / "viewer"
_SCRIPTS = ("motion.js", "flat.js", "stage.js", "ghost.js", "labels.js", "page.js")
THREE = "0.187.0"
"""Release of three.js in the folder; `three.entry.js` has the commands that put another one there."""


def viewer_page(scene: Scene, rate: float = _RATE) -> str:
    """The page that shows a scene.

    Args:
        scene: the motion.
        rate: largest number of frames per second; a faster motion keeps every second, third, ... frame.

    Returns:
        The document. The same scene gives the same bytes.
    """
    # nearly all of it is code; names from a user are escaped below
    loader = FileSystemLoader(_FOLDER, encoding="utf-8")
    environment = Environment(loader=loader, autoescape=False, undefined=StrictUndefined, keep_trailing_newline=True)
    colors = {"sides": figure.SIDES, "marker": figure.MARKER, "ellipsoid": figure.ELLIPSOID}
    colors |= {"flagged": figure.FLAGGED, "floor": figure.FLOOR, "ghost": figure.GHOST}
    library = f"\n/*\n{_part('three.LICENSE.txt').strip()}\n*/\n{_part('three.min.js')}\n"
    viewer = "\n".join(_part(name) for name in _SCRIPTS)
    scripts = library, f'\n"use strict";\nconst COLORS = {json.dumps(colors)};\n{viewer}\n'
    hashes = (base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in scripts)
    digests = " ".join(f"'sha256-{text}'" for text in hashes)  # the only scripts that may run
    # in a script, HTML reads only its end tag and the start of a comment; without "<" there is neither
    motion, title = motion_text(scene, rate).replace("<", "\\u003c"), html.escape(scene.name, quote=False)
    page, css = environment.get_template("page.html"), _part("page.css")
    return page.render(digests=digests, title=title, style=css, motion=motion, three=THREE, scripts=scripts)


def write_viewer(scene: Scene, path: str | Path) -> Path:
    """Write the page that shows a scene, whole or not at all.

    Returns:
        The path.

    Raises:
        RunError: if it cannot be written.
    """
    return save_bytes(Path(path), viewer_page(scene).encode("utf-8", "replace"))


def _part(name: str) -> str:
    """A file of the viewer."""
    return (_FOLDER / name).read_text(encoding="utf-8")
