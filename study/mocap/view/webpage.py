"""Write the viewer: one HTML page with the moving skeleton, which needs no other file and no network.

The parts of the page are in the folder ``viewer``: its style, six scripts, and the library three.js with its licence.
`page.html` joins them.
"""

import base64
import hashlib
import json
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from study.mocap.skeleton.scene import Scene
from study.mocap.view import palette
from study.mocap.view.motion_json import motion_text
from study.runs.storage.atomic_write import RunError, write

_FOLDER = Path(__file__).parent / "viewer"
_SCRIPTS = ("motion.js", "flat.js", "stage.js", "ghost.js", "labels.js", "page.js")
THREE = "0.187.0"
"""Release of three.js in the folder; `three.entry.js` has the commands that put another one there."""
_RATE = 60.0
"""Largest number of frames per second; screens show no more."""


def viewer_page(scene: Scene, rate: float = _RATE) -> str:
    """The page that shows a scene.

    Args:
        scene: the motion.
        rate: largest number of frames per second; a faster motion keeps every second, third, ... frame.

    Returns:
        The document. The same scene gives the same bytes.
    """
    environment = Environment(
        loader=FileSystemLoader(_FOLDER, encoding="utf-8"),
        autoescape=False,  # nearly all of it is code; names from a user are escaped below
        undefined=StrictUndefined,
        keep_trailing_newline=True,
    )
    scripts = _scripts()
    hashes = (base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in scripts)
    return environment.get_template("page.html").render(
        digests=" ".join(f"'sha256-{text}'" for text in hashes),  # the only scripts that may run
        title=_escaped(scene.name),
        style=_part("page.css"),
        # in a script, HTML reads only its end tag and the start of a comment; without "<" there is neither
        motion=motion_text(scene, rate).replace("<", "\\u003c"),
        three=THREE,
        scripts=scripts,
    )


def write_viewer(scene: Scene, path: str | Path, rate: float = _RATE) -> Path:
    """Write the page that shows a scene, whole or not at all.

    Returns:
        The path.

    Raises:
        RunError: if it cannot be written.
    """
    path = Path(path)
    page = viewer_page(scene, rate)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write(path, page.encode("utf-8", "replace"))
    except OSError as error:
        raise RunError(f"{path}: cannot be written: {error.strerror or error}") from None
    return path


def _scripts() -> tuple[str, str]:
    """The library with its licence, and the viewer."""
    colors = {
        "sides": palette.SIDES,
        "marker": palette.MARKER,
        "ellipsoid": palette.ELLIPSOID,
        "flagged": palette.FLAGGED,
        "floor": palette.FLOOR,
        "ghost": palette.GHOST,
    }
    library = f"\n/*\n{_part('three.LICENSE.txt').strip()}\n*/\n{_part('three.min.js')}\n"
    viewer = "\n".join(_part(name) for name in _SCRIPTS)
    return library, f'\n"use strict";\nconst COLORS = {json.dumps(colors)};\n{viewer}\n'


def _part(name: str) -> str:
    """A file of the viewer."""
    return (_FOLDER / name).read_text(encoding="utf-8")


def _escaped(text: str) -> str:
    """Text with the characters escaped that mean something in HTML."""
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
