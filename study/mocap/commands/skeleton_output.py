"""The output of `study skeleton`: its options, its files, and what is printed of them."""

import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import typer

if TYPE_CHECKING:
    from study.mocap.export.motion import ExportedMotion
    from study.mocap.skeleton.scene import Scene


@dataclass(frozen=True)
class Output:
    """The options that say what to write and to print."""

    write: str | None = field(
        default=None,
        metadata={
            "help": "further files, with commas between them: names that end in .c3d, .trc (markers and joint "
            "centres), .glb, .bvh (animated bones), .mot (joint angles) or .csv (table), or the endings alone"
        },
    )
    rest: Literal["t-pose", "recorded"] = field(
        default="t-pose",
        metadata={
            "help": "the pose of .bvh and .glb in which all rotations are zero: a T-pose, or one of the recording"
        },
    )
    video: bool = field(default=False, metadata={"help": "also write motion.mp4"})
    json: bool = field(default=False, metadata={"help": "print one JSON object, with null where there is no number"})


def written_files(motion: "ExportedMotion", folder: Path) -> Iterator[Path]:
    """Write the tables, the hierarchy, the pictures and pages of a skeleton; yields each path when the file is there.

    A hierarchy needs its root. Where no frame shows it, a message says so, and all else is written.
    """
    from study.figures.style import save
    from study.mocap.export.joint_angles import joint_angles
    from study.mocap.export.write_files import write_file
    from study.mocap.io.recording import RecordingError
    from study.mocap.skeleton import skeleton_table
    from study.mocap.view import fig1_skeleton
    from study.mocap.view.motion_json import write_motion
    from study.mocap.view.webpage import write_viewer
    from study.runs.storage.atomic_write import save_frame

    tables = {
        "skeleton": skeleton_table.skeleton_table(motion.scene),
        "bones": skeleton_table.bone_table(motion.scene),
        "angles": joint_angles(motion),
    }
    for name, table in tables.items():
        save_frame(table, folder / f"{name}.parquet")
        yield folder / f"{name}.parquet"
    try:
        yield write_file(motion, folder / "skeleton.bvh")
    except RecordingError as error:
        typer.echo(f"{folder / 'skeleton.bvh'} is not written: {error}", err=True)
    yield write_motion(motion.scene, folder / "motion.json")
    yield from save(fig1_skeleton.draw(fig1_skeleton.prepare(motion.scene)), folder / "fig1_skeleton")
    yield write_viewer(motion.scene, folder / "viewer.html")


def write_motion_video(scene: "Scene", path: Path) -> Path:
    """Write the video, with a progress bar on a terminal."""
    from study.mocap.view.video import write_video
    from study.text.shown_stream import unchanged

    raw = unchanged(sys.stderr)
    with typer.progressbar(length=1000, label="video", file=raw, hidden=not raw.isatty()) as bar:
        done = 0.0

        def advance(share: float) -> None:
            nonlocal done
            before, done = done, done + 1000 * share
            bar.update(int(done) - int(before))

        return write_video(scene, path, advance=advance)
