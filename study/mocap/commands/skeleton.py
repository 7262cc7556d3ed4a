"""The command `study skeleton`: phase 2, the skeleton of a recording in every frame."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from study.mocap.commands.options import File, MarkerSetName, Out, Reading, grouped

if TYPE_CHECKING:
    from study.mocap.markersets.match import Match
    from study.mocap.skeleton.calibration import Calibration
    from study.mocap.skeleton.scene import Scene

CalibrationFile = Annotated[
    Path | None,
    typer.Option("--calibration", help="calibration.json of the same subject, or its folder [default: calibrate here]"),
]
Force = Annotated[bool, typer.Option("--force", help="use the calibration even if it seems to be of another subject")]
Video = Annotated[bool, typer.Option("--video", help="also write motion.mp4")]


@grouped
def skeleton(
    file: File,
    *,
    calibration: CalibrationFile = None,
    force: Force = False,
    markerset: MarkerSetName = None,
    out: Out = None,
    video: Video = False,
    reading: Reading,
) -> None:
    """Draw the skeleton in every frame: phase 2.

    Writes tables, BVH, a figure, and a page that shows the moving skeleton.
    """
    from study.figures.style import save
    from study.mocap.commands.open_recording import print_lines, print_match, results_folder
    from study.mocap.skeleton import skeleton_table
    from study.mocap.skeleton.bvh import write_bvh
    from study.mocap.skeleton.calibration_file import save_calibration
    from study.mocap.skeleton.draw_skeleton import draw_skeleton
    from study.mocap.skeleton.skeleton_scene import skeleton_scene
    from study.mocap.skeleton.subject_check import overruled, require_same_subject
    from study.mocap.view import fig1_skeleton
    from study.mocap.view.motion_json import write_motion
    from study.mocap.view.video import encoder
    from study.mocap.view.webpage import write_viewer
    from study.runs.storage.atomic_write import save_frame

    if force and calibration is None:
        raise typer.BadParameter("--force: there is nothing to overrule without --calibration")
    if video:
        encoder()  # so that a missing one is reported before the work is done
    match, used = _calibrated(file, reading, calibration, markerset)
    folder = results_folder(match.source.name, out)
    print_match(match)
    print_lines(used.lines())
    drawn = draw_skeleton(used, match.recording)
    print_lines(overruled(drawn) if force else [])
    drawn = drawn if force else require_same_subject(drawn)
    scene = skeleton_scene(drawn, match.recording)
    print_lines(skeleton_table.skeleton_lines(scene))
    save_frame(skeleton_table.skeleton_table(scene), folder / "skeleton.parquet")
    save_frame(skeleton_table.bone_table(scene), folder / "bones.parquet")
    paths = [folder / "skeleton.parquet", folder / "bones.parquet"]
    if calibration is None:
        paths.append(save_calibration(used, folder / "calibration.json"))
    paths.append(write_bvh(drawn, folder / "skeleton.bvh"))
    paths.append(write_motion(scene, folder / "motion.json"))
    paths += save(fig1_skeleton.draw(fig1_skeleton.prepare(scene)), folder / "fig1_skeleton")
    paths.append(write_viewer(scene, folder / "viewer.html"))
    print_lines(paths)
    if video:
        print_lines([_write_video(scene, folder / "motion.mp4")])


def _calibrated(
    file: Path, reading: Reading, calibration: Path | None, markerset: str | None
) -> "tuple[Match, Calibration]":
    """A recording, and the given calibration, or one that is fitted to the recording itself."""
    from study.mocap.commands.open_recording import open_recording
    from study.mocap.markersets.match import match
    from study.mocap.skeleton.calibrate import calibrate
    from study.mocap.skeleton.calibration_file import load_calibration

    if calibration is None:
        found = open_recording(file, markerset, reading)
        return found, calibrate(found.recording, found.markerset)
    if markerset is not None:
        raise typer.BadParameter(f"--markerset {markerset}: a calibration has its own marker set; leave it out")
    used = load_calibration(calibration / "calibration.json" if calibration.is_dir() else calibration)
    return match(used.markerset, reading.read(file)), used


def _write_video(scene: "Scene", path: Path) -> Path:
    """Write the video, with a progress bar on a terminal."""
    from study.mocap.view.video import write_video

    with typer.progressbar(length=1000, label="video", file=sys.stderr, hidden=not sys.stderr.isatty()) as bar:
        done = 0.0

        def advance(share: float) -> None:
            nonlocal done
            before, done = done, done + 1000 * share
            bar.update(int(done) - int(before))

        return write_video(scene, path, advance=advance)
