"""The viewer: one HTML page with the moving skeleton in it, which needs no other file and no network.

The page's parts are in the folder ``viewer``: its look, four scripts of one idea each, and three.js, which draws, with
its licence. `page.html` says where each goes.
"""

import json
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from study.mocap.skeleton.scene import Scene
from study.mocap.view import palette
from study.mocap.view.motion_json import motion_text
from study.runs.storage.atomic_write import RunError, write

_FOLDER = Path(__file__).parent / "viewer"
_SCRIPTS = ("motion.js", "stage.js", "labels.js", "page.js")
THREE = "0.187.0"
"""Release of three.js in the folder; `three.entry.js` says how another one gets there."""
_RATE = 60.0
"""Frames per second, at most: screens show no more."""


def viewer(scene: Scene, rate: float = _RATE) -> str:
    """The page that shows a scene.

    Args:
        scene: the motion.
        rate: frames per second in the page, at most; of a faster motion every second, third, ... frame is taken.

    Returns:
        The document. The same scene gives the same bytes.
    """
    environment = Environment(
        loader=FileSystemLoader(_FOLDER, encoding="utf-8"),
        autoescape=False,  # nearly all is code; what a user named is escaped where it is put in
        undefined=StrictUndefined,
        keep_trailing_newline=True,
    )
    return environment.get_template("page.html").render(
        title=_escaped(scene.name),
        style=_part("page.css"),
        # within a script only its end tag, and what begins a comment, mean something; no "<" is left in JSON
        motion=motion_text(scene, rate).replace("<", "\\u003c"),
        licence=_part("three.LICENSE.txt").strip(),
        three=THREE,
        library=_part("three.min.js"),
        looks=json.dumps(
            {
                "sides": palette.SIDES,
                "marker": palette.MARKER,
                "ellipsoid": palette.ELLIPSOID,
                "flagged": palette.FLAGGED,
                "floor": palette.FLOOR,
            }
        ),
        script="\n".join(_part(name) for name in _SCRIPTS),
    )


def write_viewer(scene: Scene, path: str | Path, rate: float = _RATE) -> Path:
    """Write the page that shows a scene, whole or not at all.

    Returns:
        The path.

    Raises:
        RunError: if it cannot be written.
    """
    path = Path(path)
    page = viewer(scene, rate)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write(path, page.encode("utf-8", "replace"))
    except OSError as error:
        raise RunError(f"{path}: cannot be written: {error.strerror or error}") from None
    return path


def _part(name: str) -> str:
    return (_FOLDER / name).read_text(encoding="utf-8")


def _escaped(text: str) -> str:
    """Text as it may stand in HTML."""
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
