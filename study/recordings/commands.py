"""Commands on recordings.

`study joints` is phase 1, `study skeleton` phase 2, `study gait` reports walks; `study joint` finds one joint, `study
case-study` repeats the paper's precision study. `study recording` and `study markersets` are there to look, `study
fetch` downloads a recording, and `study synthetic` makes one of a body whose joints are known.
"""

import functools
import inspect
import re
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from study.options import ExitCode, Json, echo, unchanged
from study.text import json_text

if TYPE_CHECKING:
    from study.recordings.export.tree import ExportedMotion
    from study.recordings.markersets import Match
    from study.recordings.recording import Recording
    from study.recordings.skeleton.scene import Scene

File = Annotated[Path, typer.Argument(metavar="FILE", help="a recording: .c3d, .trc, .csv, .tsv or .txt")]
_SET = "name of a shipped marker set, or a file [default: the shipped one that fits best]"
MarkerSetName = Annotated[str | None, typer.Option("--markerset", help=_SET)]
Out = Annotated[Path | None, typer.Option("--out", help="folder of the results [default: results/recordings/<name>]")]
_UNIT = "m, cm, mm, in or ft, if the file lacks its unit or has a wrong one"
Unit = Annotated[str | None, typer.Option("--unit", help=_UNIT)]
_RATE = "frames per second, if the file lacks its rate or has a wrong one"
Rate = Annotated[float | None, typer.Option("--rate", help=_RATE)]
Subject = Annotated[
    str | None, typer.Option("--subject", help="the subject to read, if the file has several; all: one after another")
]
_FRAMES = "read these frames alone, from 1, both ends included; `study recording` says which are whole"
FrameRange = Annotated[str | None, typer.Option("--frames", metavar="1-499", help=_FRAMES)]
_HIPS = (
    "hips that motion leaves in doubt: as they are, or by regression from the pelvis' spines, or the file's LHJC, RHJC"
)
HipCentres = Annotated[Literal["motion", "regression"], typer.Option("--hips", help=_HIPS)]
_WIDTHS = "widths of knees and ankles, mm, if the file lacks them, for the chord method of Plug-in Gait"
Widths = Annotated[str, typer.Option("--widths", metavar="LKneeWidth=105,...", help=_WIDTHS)]
_SEGMENTS = "use these segments alone, with commas between them, or legs for pelvis and legs [default: all]"
Segments = Annotated[str, typer.Option("--segments", metavar="A,B", help=_SEGMENTS)]
_ERROR = "standard error above which a joint is missing in a frame, metres"
LargestError = Annotated[float, typer.Option("--largest-error", help=_ERROR)]
_ANGLE = "standard error above which an angle is missing in a frame, degrees"
LargestAngleError = Annotated[float, typer.Option("--largest-angle-error", help=_ANGLE)]
_PARENT = "labels of three or more markers of the parent segment"
Parent = Annotated[str, typer.Option("--parent", metavar="A,B,C", help=_PARENT)]
_CHILD = "labels of markers of the child segment, which rotates about the joint"
Child = Annotated[str, typer.Option("--child", metavar="D,E,F", help=_CHILD)]

RESULTS = Path("results") / "recordings"
"""The folder with a folder for each recording's results."""


def results_folder(name: str, out: Path | None = None) -> Path:
    """The folder for the results of a recording: ``out`` if given, else a folder of `RESULTS`.

    Any name, even ``..``, gives a folder directly below `RESULTS`.

    Raises:
        RecordingError: if there is a file of that name.
    """
    from study.recordings.recording import RecordingError

    plain = re.sub(r"[^\w.-]+", "-", name).strip(".-") or "recording"
    folder = RESULTS / plain[:100] if out is None else out
    if folder.exists() and not folder.is_dir():
        raise RecordingError(f"{folder}: is a file, not a folder; choose another with --out")
    return folder


def _read(
    file: Path, unit: str | None, rate: float | None, subject: str | None, frames: str | None, widths: str = ""
) -> "Recording":
    """The recording of a file, by the options that all commands have."""
    from study.recordings.formats.read import read_recording
    from study.recordings.recording import with_widths

    recording = read_recording(file, unit=unit, rate=rate, subject=subject, frames=frames)
    return with_widths(recording, widths) if widths else recording


def _print_match(match: "Match", calibrated: bool = False) -> None:
    """Print the notes about a recording, and how the marker set, or that of a calibration, fits it."""
    echo(f"note: {note}" for note in match.source.notes)
    echo(match.lines(calibrated))


def _each_subject(command: Callable[..., None]) -> Callable[..., None]:
    """A command that does ``--subject all``: each subject of the first file, with a folder of its own in that of --out.

    A calibration is that of the subject, in the folder of its name. A subject that cannot be used is told, and the next
    one follows; the first fault ends the command.
    """

    @functools.wraps(command)
    def run(*arguments: object, **named: object) -> None:
        call = inspect.signature(command).bind(*arguments, **named)
        call.apply_defaults()
        options = call.arguments
        if options["subject"] != "all":
            return command(**options)
        if options["as_json"]:
            raise typer.BadParameter("--subject all: there is one JSON object for each subject; give one subject")
        file, given = options["file"] if "file" in options else options["files"][0], options.get("calibration")
        from study.recordings.formats.read import subjects_of
        from study.recordings.markersets import MarkerSetError
        from study.recordings.recording import RecordingError

        faults: list[Exception] = []
        names: list[str | None] = [*subjects_of(file)]
        for name in names or [None]:
            own = options | {"subject": name}
            if name is not None:
                typer.echo(f"subject {name}:")
                if "out" in options:
                    own["out"] = results_folder(file.stem, options["out"]) / results_folder(name).name
                if given is not None and (given / results_folder(name).name).is_dir():
                    own["calibration"] = given / results_folder(name).name
            try:
                command(**own)
            except (RecordingError, MarkerSetError) as fault:
                complain(str(fault))
                faults.append(fault)
        if faults:
            raise faults[0]
        return None

    return run


def complain(words: str) -> None:
    """Print a line on standard error."""
    typer.echo(words, err=True)


@_each_subject
def case_study(
    file: File,
    markerset: MarkerSetName = None,
    out: Out = None,
    subsets: Annotated[int, typer.Option(help="subsets of each size and joint, a multiple of four")] = 400,
    seed: Annotated[int, typer.Option(help="seed of the subsets")] = 1,
    as_json: Json = False,
    unit: Unit = None,
    rate: Rate = None,
    subject: Subject = None,
    frames: FrameRange = None,
) -> None:
    """Repeat the paper's precision study, section 9.1.

    Fits each joint to many parts of a recording; writes tables of the scatter, and figure 7.

    With --json: recording, frames, subsets; laws and joints, as in the tables; skipped, and files.
    """
    from study.files import save_frame
    from study.recordings import case_study as precision_study
    from study.recordings.joints.find import find_joints
    from study.recordings.markersets import place_markerset
    from study.recordings.recording import digest_of, with_origin
    from study.style import save

    match, digest = place_markerset(_read(file, unit, rate, subject, frames), markerset), digest_of(file)
    folder = results_folder(match.source.name, out)
    if not as_json:
        _print_match(match)
    case = precision_study.case_study(find_joints(match.markerset, match.recording), match.recording, subsets, seed)
    echo([] if as_json else precision_study.printed(case))
    tables = {"scatter": case.scatter, "joints": case.joints, "laws": case.laws}
    paths = [folder / f"case-study-{name}.parquet" for name in tables]
    for table, path in zip(tables.values(), paths, strict=True):
        save_frame(with_origin(table, case.recording, digest), path)
    paths += save(precision_study.draw(case), folder / "fig7_case")
    echo([json_text(case.data() | {"files": paths})] if as_json else paths)


_ACROSS = "lateral and medial point, midway between which a hinge lies"


def joint(
    file: File,
    parent: Parent,
    child: Child,
    hinge: Annotated[bool, typer.Option("--hinge", help="the joint is a hinge, such as a knee or an elbow")] = False,
    across: Annotated[str, typer.Option(metavar="G,H", help=_ACROSS)] = "",
    as_json: Annotated[bool, typer.Option("--json", help="print the joint as JSON, in metres and degrees")] = False,
    unit: Unit = None,
    rate: Rate = None,
    subject: Subject = None,
    frames: FrameRange = None,
) -> None:
    """Find one joint, from the markers of its two segments.

    Prints one line, and compares with joint centres that other programs left in the file. The exit code is 3 if the
    joint is not ok.
    """
    from study.recordings.one_joint import find_clusters, fit_one_joint, joint_json, joint_line

    if across and not hinge:
        raise typer.BadParameter("--across: only a hinge has an axis; give --hinge, too")
    source = _read(file, unit, rate, subject, frames)
    answer = fit_one_joint(source, find_clusters(source, parent, child, across, hinge))
    notes = (f"note: {note}" for note in source.notes)
    echo([joint_json(answer)] if as_json else [*notes, joint_line(answer)])
    if not answer.ok:
        raise typer.Exit(ExitCode.TOO_MANY_FAILURES)


_FILES = "a recording, or several of one session: .c3d, .trc, .csv, .tsv or .txt"
_STATIC = "a trial that gives the shapes of the segments, such as a static one"
_MERGE = "merge trials even if they seem to show different subjects"


@_each_subject
def joints(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help=_FILES)],
    static: Annotated[Path | None, typer.Option(help=_STATIC)] = None,
    force: Annotated[bool, typer.Option("--force", help=_MERGE)] = False,
    segments: Segments = "",
    hips: HipCentres = "motion",
    widths: Widths = "",
    markerset: MarkerSetName = None,
    out: Out = None,
    as_json: Json = False,
    unit: Unit = None,
    rate: Rate = None,
    subject: Subject = None,
    frames: FrameRange = None,
) -> None:
    """Find the joints of a recording: phase 1.

    Writes their table, and a calibration with which `study skeleton` draws other recordings of the same subject.
    Several trials of a session give one calibration: each joint comes from the trials that moved it.

    With --json: recording, notes, markerset, joints (the columns of the table), files, and for one recording
    without_pose.
    """
    from study.files import save_frame
    from study.recordings.joints import report
    from study.recordings.joints.find import save_calibration
    from study.recordings.session import fit_session, session_lines, session_table
    from study.recordings.skeleton.anatomy import regression_hint
    from study.recordings.skeleton.calibrate import with_joints
    from study.recordings.skeleton.scene import up_of

    if len(files) == 1 and static is None and force:
        raise typer.BadParameter("--force: there is nothing to overrule with one recording")
    every = [*files, *([] if static is None else [static])]
    if len(every) > 1 and frames is not None:
        raise typer.BadParameter(f"--frames {frames}: a range is of one recording; give one")
    recordings = [_read(file, unit, rate, subject, frames, widths) for file in every]
    folder, further = results_folder("-".join(one.name for one in recordings), out), dict[str, object]()
    if len(recordings) > 1:
        match, session = fit_session(recordings, static is not None, markerset, hips, segments, force)
        calibration, table, lines = session.calibration, session_table(session), session_lines(session)
    else:
        match, calibration = with_joints(recordings[0], None, markerset, hips, segments)
        compared = report.agreement_table(calibration, match.recording)
        lines = chain(report.joint_lines(calibration), report.agreement_lines(compared), calibration.warnings())
        table = report.joint_table(calibration).merge(compared, on="joint")
        table["warnings"] = ["; ".join(place.warnings) for place in calibration.joints]
        further["without_pose"] = calibration.without_pose
    save_frame(table, folder / "joints.parquet")  # first: what reads the lines may stop reading, as `head` does
    paths = [folder / "joints.parquet", save_calibration(calibration, folder / "calibration.json")]
    if not as_json:
        _print_match(match)
        echo([*lines, f"note: {up_of(match.source)[1]}", *regression_hint(calibration, match.source)])
    head = {"recording": match.source.name, "notes": list(match.source.notes), "markerset": match.data()}
    data = head | {"joints": table.to_dict("records")} | further | {"files": paths}
    echo([json_text(data)] if as_json else paths)


def fetch(
    library: Annotated[str, typer.Argument(metavar="LIBRARY", help="cmu")],
    name: Annotated[str, typer.Argument(metavar="NAME", help="subject and trial of the recording, such as 60_08")],
    as_json: Json = False,
) -> None:
    """Download a recording from a public library.

    Prints its path in the cache; a recording that is there is not downloaded again.

    With --json: library, name, file and terms.
    """
    from study.recordings.formats import write

    try:
        path = write.fetch(library, name)
    except write.DownloadError as error:  # a failure, not a mistake of the user
        complain(str(error))
        raise typer.Exit(1) from None
    terms = write.LIBRARIES[library]
    if not as_json:
        complain(f"{library}: {terms}")
    echo([json_text({"library": library, "name": name, "file": path, "terms": terms}) if as_json else path])


def markersets(
    name: Annotated[str | None, typer.Argument(metavar="[NAME]", help="print this one [default: list all]")] = None,
    as_json: Json = False,
) -> None:
    """List the shipped marker sets, or print one.

    `study markersets cmu41 > mine.toml` is a start for a marker set of your own, which --markerset mine.toml uses.

    With --json: markersets, each with name, about, segments, joints, optional and aliases.
    """
    from study.recordings.markersets import described, load_markerset, shipped, shipped_text

    if as_json:
        names = shipped() if name is None else [name]
        typer.echo(json_text({"markersets": [load_markerset(word).model_dump() for word in names]}))
    elif name is None:
        echo(described())
    else:
        typer.echo(shipped_text(name), nl=False)


@_each_subject
def recording(
    file: File,
    as_json: Json = False,
    unit: Unit = None,
    rate: Rate = None,
    subject: Subject = None,
    frames: FrameRange = None,
) -> None:
    """Describe a recording.

    Prints its markers, frames and rate, the gaps of each marker, and the marker set that fits best.

    With --json: recording, rate, frames, duration, missing, notes, markers, whole and markerset (null if none fits).
    """
    from study.recordings.markersets import MarkerSetError, choose
    from study.recordings.recording import describe, recording_data

    source = _read(file, unit, rate, subject, frames)
    try:
        match, reason = choose(source), ""
    except MarkerSetError as error:  # a recording that no marker set fits can be described, too
        match, reason = None, str(error).removeprefix(f"{source.name}: ")
    if as_json:
        typer.echo(json_text(recording_data(source) | {"markerset": match.data() if match else None}))
    else:
        echo([*describe(source), *([reason] if match is None else match.lines())])


def _written_files(motion: "ExportedMotion", folder: Path) -> Iterator[Path]:
    """Write the tables, the hierarchy, the pictures and pages of a skeleton; yields each path when the file is there.

    A hierarchy needs its root. Where no frame shows it, a message says so, and all else is written.
    """
    from study.files import save_frame
    from study.recordings.export import write_file
    from study.recordings.export.tree import joint_angles
    from study.recordings.recording import RecordingError
    from study.recordings.skeleton.scene import bone_table, skeleton_table
    from study.recordings.view import figure
    from study.recordings.view.webpage import write_motion, write_viewer
    from study.style import save

    tables = {"skeleton": skeleton_table(motion.scene), "bones": bone_table(motion.scene)}
    for name, table in (tables | {"angles": joint_angles(motion)}).items():
        save_frame(table, folder / f"{name}.parquet")
        yield folder / f"{name}.parquet"
    try:
        yield write_file(motion, folder / "skeleton.bvh")
    except RecordingError as error:
        complain(f"{folder / 'skeleton.bvh'} is not written: {error}")
    yield write_motion(motion.scene, folder / "motion.json")
    yield from save(figure.draw(motion.scene), folder / "fig1_skeleton")
    yield write_viewer(motion.scene, folder / "viewer.html")


def _write_video(scene: "Scene", path: Path) -> Path:
    """Write the video, with a progress bar on a terminal."""
    from study.recordings.view.figure import write_video

    raw = unchanged(sys.stderr)
    with typer.progressbar(length=1000, label="video", file=raw, hidden=not raw.isatty()) as bar:
        done = 0.0

        def advance(share: float) -> None:
            nonlocal done
            before, done = done, done + 1000 * share
            bar.update(int(done) - int(before))

        return write_video(scene, path, advance)


_CALIBRATION = "calibration.json of the same subject, or its folder [default: calibrate here]"
_FORCE = "use the calibration even if it seems to be of another subject"
_REFIT = "fit the calibration's segment shapes to this recording; its joints stay"
_WRITE = (
    "further files, with commas between them: names that end in .c3d, .trc (markers and joint centres), .glb, .bvh "
    "(animated bones), .mot (joint angles) or .csv (table), or the endings alone"
)
_REST = "the pose of .bvh and .glb in which all rotations are zero: a T-pose, or one of the recording"


@_each_subject
def skeleton(
    file: File,
    calibration: Annotated[Path | None, typer.Option(help=_CALIBRATION)] = None,
    force: Annotated[bool, typer.Option("--force", help=_FORCE)] = False,
    refit: Annotated[bool, typer.Option("--refit", help=_REFIT)] = False,
    segments: Segments = "",
    hips: HipCentres = "motion",
    widths: Widths = "",
    markerset: MarkerSetName = None,
    out: Out = None,
    write: Annotated[str | None, typer.Option(help=_WRITE)] = None,
    rest: Annotated[Literal["t-pose", "recorded"], typer.Option(help=_REST)] = "t-pose",
    video: Annotated[bool, typer.Option("--video", help="also write motion.mp4")] = False,
    largest_error: LargestError = 0.05,
    largest_angle_error: LargestAngleError = 10.0,
    as_json: Json = False,
    unit: Unit = None,
    rate: Rate = None,
    subject: Subject = None,
    frames: FrameRange = None,
) -> None:
    """Draw the skeleton in every frame: phase 2.

    Writes tables, BVH, a figure, and a page that shows the moving skeleton; with --write also files for other programs.

    With --json: recording, rate, frames, source of the joints; joints, each with its doubt, error, shares of the frames
    in which it is seen, bridged, unknown and outside of the markers' hull, and the distance; bones, each with length,
    spread, error and uneven; notes, angles (what they are), overruled and files.
    """
    from study.recordings import export
    from study.recordings.export import tree
    from study.recordings.joints.find import save_calibration
    from study.recordings.recording import printable
    from study.recordings.session import refit_shapes
    from study.recordings.skeleton import anatomy, calibrate, draw, scene
    from study.recordings.skeleton.gate import gated
    from study.recordings.view.figure import encoder

    if calibration is None and force:
        raise typer.BadParameter("--force: there is nothing to overrule without --calibration")
    if calibration is None and refit:
        raise typer.BadParameter("--refit: there are no shapes to refit without --calibration")
    if calibration is not None and hips != "motion":
        raise typer.BadParameter("--hips regression: a calibration has its hips; give the option to `study joints`")
    if calibration is not None and widths:
        raise typer.BadParameter(f"--widths {widths}: a calibration has its joints; give them to `study joints`")
    if calibration is not None and markerset is not None:
        raise typer.BadParameter(f"--markerset {markerset}: a calibration has its own marker set; leave it out")
    if video:
        encoder()  # so that a missing one is reported before the work is done
    name = printable(file.stem)
    folder = results_folder(name, out)
    further = export.planned_files(write or "", folder, name, file)
    source = _read(file, unit, rate, subject, frames, widths)
    match, used = calibrate.with_joints(source, calibration, markerset, hips, segments)
    if not as_json:
        _print_match(match, calibration is not None)
        echo([*used.lines(), *(anatomy.regression_hint(used, source) if calibration is None else [])])
    remarks = [] if calibration is None else calibrate.require_same_subject(used, match.recording, refit, force)
    used = refit_shapes(used, match.recording) if refit else used
    drawn = gated(draw.draw_skeleton(used, match.recording, largest_error=largest_error), source)
    shown = scene.skeleton_scene(drawn, match.recording, remarks)
    if not as_json:
        echo([*(found.text for found in drawn.barred), *scene.skeleton_lines(shown, used), *tree.angle_lines(used)])
    motion = tree.ExportedMotion(drawn, match.source, shown, file, tree.RestPose(rest), largest_angle_error)

    def written() -> Iterator[Path]:
        if calibration is None:
            yield save_calibration(used, folder / "calibration.json")
        yield from _written_files(motion, folder)
        yield from (export.write_file(motion, path) for path in further)
        if video:
            yield _write_video(shown, folder / "motion.mp4")

    paths: list[Path] = []
    for path in written():
        paths.append(path)
        echo([] if as_json else [path])
    if as_json:
        further_data = {"angles": tree.angle_lines(used), "overruled": remarks, "files": paths}
        typer.echo(json_text(scene.skeleton_data(shown) | further_data))


_WALKS = "walks of one subject: .c3d, .trc, .csv, .tsv or .txt"
_WRITE_EVENTS = "the walks with their events: .c3d for each walk's name, or the name of a C3D file for one walk"


@_each_subject
def gait(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help=_WALKS)],
    calibration: Annotated[Path | None, typer.Option(help=_CALIBRATION)] = None,
    static: Annotated[Path | None, typer.Option(help=_STATIC)] = None,
    force: Annotated[bool, typer.Option("--force", help=_FORCE)] = False,
    hips: HipCentres = "motion",
    widths: Widths = "",
    markerset: MarkerSetName = None,
    largest_angle_error: LargestAngleError = 10.0,
    out: Out = None,
    write: Annotated[str, typer.Option(help=_WRITE_EVENTS)] = "",
    as_json: Json = False,
    unit: Unit = None,
    rate: Rate = None,
    subject: Subject = None,
) -> None:
    """Report the angles of pelvis and legs over the gait cycle.

    Events come from the file, else from force plates, else from the markers of the feet. Writes the page of the report,
    its figure, and tables of the cycles, of each cycle's curves, and of their means. Without --calibration the joints
    are found in the walks themselves.

    With --json: cycles, each with recording, side, start, end, duration, stance, stride, speed, cadence, step, width,
    double_support and events; means, each with side, joint, angle, percent, mean, sd, cycles, error and total; events,
    each with recording, side, kind, time and source; notes and files.
    """
    from study.files import save_frame
    from study.recordings import export
    from study.recordings import gait as gaits
    from study.recordings.api import find_gait
    from study.recordings.recording import printable, written
    from study.recordings.view import gait as view
    from study.style import save

    if calibration is not None and (static, hips, widths, markerset) != (None, "motion", "", None):
        words = "--static, --hips, --widths, --markerset: a calibration has its own; give them to `study joints`"
        raise typer.BadParameter(words)
    folder = results_folder("-".join(printable(file.stem) for file in files)[:100] + "-gait", out)
    planned = [path for file in files for path in export.planned_files(write, folder, printable(file.stem), file)]
    if any(path.suffix.lower() != ".c3d" for path in planned) or len({*planned}) < len(planned):
        raise typer.BadParameter(f"--write {write}: events are written to .c3d, a file for each walk")
    walks = [_read(file, unit, rate, subject, None, widths) for file in files]
    still = None if static is None else _read(static, unit, rate, subject, None, widths)
    limit = largest_angle_error
    found = find_gait(walks, calibration, markerset, static=still, hips=hips, force=force, largest_angle_error=limit)
    title = ", ".join(dict.fromkeys(walk.name for walk in walks))
    if not as_json:
        echo(gaits.gait_lines(found))
    paths = [view.write_page(found, title, folder / "gait.html"), *save(view.draw(found), folder / "fig_gait")]
    tables = {"cycles": found.cycles, "curves": found.curves, "means": (means := found.means())}
    for name, table in tables.items():
        save_frame(table, folder / f"gait_{name}.parquet")
        paths.append(folder / f"gait_{name}.parquet")
    for path, file, motion, events in zip(planned, files, found.motions, found.events, strict=False):
        fill = functools.partial(export.write_c3d, replace(motion, source=file), events=events)
        paths.append(written(path, fill))
    records: dict[str, object] = {"cycles": found.cycles.to_dict("records"), "means": means.to_dict("records")}
    each = zip(found.motions, found.events, strict=True)
    told = [{"recording": m.skeleton.name} | e._asdict() for m, events in each for e in events]
    records |= {"events": told, "notes": found.notes, "files": paths}
    echo([json_text(records)] if as_json else paths)


_OUT = ".c3d, .trc or .csv [default: results/recordings/synthetic-<seed>/synthetic-<seed>.c3d]"
_TISSUE = "largest soft-tissue artefact of a marker, metres"
_SKIN = "law of the soft-tissue artefact: mixed, random, angle, velocity, cluster, slide"
_SWAPS = "share of the frames in which two markers are exchanged"
_HEIGHT = "height of the body, metres; another height gives another subject"
_ANEW = "draw each frame anew instead of a smooth motion"
_GAIT = "move as in walking: in strides, little out of the sagittal plane"
_MARKERS = "marker set that the body wears: cmu41, or rizzoli, the landmarks of trunk and legs"


def synthetic(
    out: Annotated[Path | None, typer.Option(help=_OUT)] = None,
    as_json: Json = False,
    frames: Annotated[int, typer.Option(help="number of frames")] = 3000,
    rate: Annotated[float, typer.Option(help="frames per second")] = 120.0,
    seed: Annotated[int, typer.Option(help="seed of all random numbers")] = 1,
    noise: Annotated[float, typer.Option(help="standard deviation of a marker's coordinate, metres")] = 0.001,
    soft_tissue: Annotated[float, typer.Option(help=_TISSUE)] = 0.0,
    skin: Annotated[str, typer.Option(help=_SKIN)] = "mixed",
    gaps: Annotated[float, typer.Option(help="share of each marker's samples that are missing")] = 0.0,
    swaps: Annotated[float, typer.Option(help=_SWAPS)] = 0.0,
    height: Annotated[float, typer.Option(help=_HEIGHT)] = 1.75,
    reach: Annotated[float, typer.Option(help="share of the natural range of motion")] = 1.0,
    independent: Annotated[bool, typer.Option("--independent", help=_ANEW)] = False,
    gait: Annotated[bool, typer.Option("--gait", help=_GAIT)] = False,
    markers: Annotated[str, typer.Option(help=_MARKERS)] = "cmu41",
) -> None:
    """Make a recording of a synthetic body.

    Writes the recording, and tables of the true joints beside it. With --json: recording, frames, rate and files.
    """
    from study.recordings.formats.write import write_recording
    from study.recordings.recording import RecordingError
    from study.recordings.synthetic.make import Recipe, synthesize, write_truth

    numbers = frames, rate, seed, noise, soft_tissue, skin, gaps, swaps, height, reach
    recipe = Recipe(*numbers, independent=independent, gait=gait, markers=markers)
    if skin != "mixed" and not soft_tissue:
        raise RecordingError(f"--skin {skin}: skin moves by 0 m; give its largest motion with --soft-tissue")
    made, truth = synthesize(recipe)
    path = write_recording(made, out or results_folder(made.name) / f"{made.name}.c3d")
    paths = [path, *write_truth(truth, path)]
    data = {"recording": made.name, "frames": made.frames, "rate": made.rate, "files": paths}
    echo([json_text(data)] if as_json else paths)
