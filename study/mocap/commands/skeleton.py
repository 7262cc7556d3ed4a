"""The command `study skeleton`: phase 2, the skeleton of a recording in every frame."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from study.mocap.commands.options import File, MarkerSetName, Out, Reading, grouped
from study.mocap.commands.skeleton_output import Output

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from study.mocap.export.motion import ExportedMotion
    from study.mocap.markersets.match import Match
    from study.mocap.skeleton.calibration import Calibration


@dataclass(frozen=True)
class Given:
    """The options on a calibration that is given."""

    calibration: Path | None = field(
        default=None, metadata={"help": "calibration.json of the same subject, or its folder [default: calibrate here]"}
    )
    force: bool = field(
        default=False, metadata={"help": "use the calibration even if it seems to be of another subject"}
    )
    refit: bool = field(
        default=False, metadata={"help": "fit the calibration's segment shapes to this recording; its joints stay"}
    )

    def require_sense(self) -> None:
        """Refuse options that say how to use a calibration where none is given."""
        if self.calibration is None and self.force:
            raise typer.BadParameter("--force: there is nothing to overrule without --calibration")
        if self.calibration is None and self.refit:
            raise typer.BadParameter("--refit: there are no shapes to refit without --calibration")


@grouped
def skeleton(
    file: File,
    *,
    given: Given,
    markerset: MarkerSetName = None,
    out: Out = None,
    output: Output,
    reading: Reading,
) -> None:
    """Draw the skeleton in every frame: phase 2.

    Writes tables, BVH, a figure, and a page that shows the moving skeleton; with --write also files for other programs.

    With --json: recording, rate, frames, source of the joints; joints, each with its doubt, error, shares of the frames
    in which it is seen, bridged, unknown and outside of the markers' hull, and the distance; bones, each with length,
    spread, error and uneven; notes, overruled and files.
    """
    from study.mocap.commands.open_recording import print_lines, print_match, results_folder
    from study.mocap.export.motion import ExportedMotion
    from study.mocap.export.rest_pose import RestPose
    from study.mocap.export.write_files import planned_files
    from study.mocap.io.labels import printable
    from study.mocap.session.session import refit_shapes
    from study.mocap.skeleton.draw_skeleton import draw_skeleton
    from study.mocap.skeleton.skeleton_data import skeleton_data
    from study.mocap.skeleton.skeleton_scene import skeleton_scene
    from study.mocap.skeleton.skeleton_table import skeleton_lines
    from study.mocap.skeleton.subject_check import overruled, require_same_subject
    from study.mocap.view.video import encoder
    from study.text.json_text import json_text

    given.require_sense()
    if output.video:
        encoder()  # so that a missing one is reported before the work is done
    name = printable(file.stem)
    folder = results_folder(name, out)
    further = planned_files(output.write or "", folder, name, file)
    match, used = _calibrated(file, reading, given.calibration, markerset)
    if not output.json:
        print_match(match)
        print_lines(used.lines())
    drawn = draw_skeleton(used, match.recording)
    remarks = overruled(drawn) if given.force else []
    drawn = drawn if given.force else require_same_subject(drawn)
    if given.refit:
        used = refit_shapes(used, match.recording)
        drawn = draw_skeleton(used, match.recording)
    scene = skeleton_scene(drawn, match.recording)
    if not output.json:
        print_lines([*remarks, *skeleton_lines(scene)])
    motion = ExportedMotion(drawn, match.source, scene, file, RestPose(output.rest))
    paths: list[Path] = []
    for path in _written(motion, output, folder, [] if given.calibration else [used], further):
        paths.append(path)
        print_lines([] if output.json else [path])
    if output.json:
        typer.echo(json_text(skeleton_data(scene) | {"overruled": remarks, "files": paths}))


def _written(
    motion: "ExportedMotion", output: Output, folder: Path, own: "Sequence[Calibration]", further: "Sequence[Path]"
) -> "Iterator[Path]":
    """Write all files; yields the path of each when it is there."""
    from study.mocap.commands.skeleton_output import write_motion_video, written_files
    from study.mocap.export.write_files import write_file
    from study.mocap.skeleton.calibration_file import save_calibration

    yield from (save_calibration(calibration, folder / "calibration.json") for calibration in own)
    yield from written_files(motion, folder)
    yield from (write_file(motion, path) for path in further)
    if output.video:
        yield write_motion_video(motion.scene, folder / "motion.mp4")


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
