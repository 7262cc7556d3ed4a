"""Commands that find joints: `study joints` (phase 1), `study joint`, `study live` and `study case-study`."""

import signal
import sys
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from study.options import ExitCode, Json, echo
from study.recordings.commands import (
    File,
    FrameRange,
    HipCentres,
    MarkerSetName,
    Out,
    Rate,
    Subject,
    Unit,
    print_match,
    results_folder,
)

if TYPE_CHECKING:
    from study.recordings.live import LiveJoints


Subsets = Annotated[int, typer.Option("--subsets", help="subsets of each size and joint, a multiple of four")]
Seed = Annotated[int, typer.Option("--seed", help="seed of the subsets")]


def case_study(
    file: File,
    markerset: MarkerSetName = None,
    out: Out = None,
    subsets: Subsets = 400,
    seed: Seed = 1,
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
    from study.recordings.formats.read import read_recording
    from study.recordings.joints.find import find_joints
    from study.recordings.markersets import place_markerset
    from study.recordings.recording import digest_of, with_origin
    from study.style import save
    from study.text import json_text

    recording = read_recording(file, unit=unit, rate=rate, subject=subject, frames=frames)
    match, digest = place_markerset(recording, markerset), digest_of(file)
    folder = results_folder(match.source.name, out)
    if not as_json:
        print_match(match)
    case = precision_study.case_study(find_joints(match.markerset, match.recording), match.recording, subsets, seed)
    echo([] if as_json else precision_study.printed(case))
    paths = []
    for name, table in {"scatter": case.scatter, "joints": case.joints, "laws": case.laws}.items():
        paths.append(folder / f"case-study-{name}.parquet")
        save_frame(with_origin(table, case.recording, digest), paths[-1])
    paths += save(precision_study.draw(case), folder / "fig7_case")
    echo([json_text(case.data() | {"files": paths})] if as_json else paths)


_PARENT = "labels of three or more markers of the parent segment"
Parent = Annotated[str, typer.Option("--parent", metavar="A,B,C", help=_PARENT)]
_CHILD = "labels of markers of the child segment, which rotates about the joint"
Child = Annotated[str, typer.Option("--child", metavar="D,E,F", help=_CHILD)]
Hinge = Annotated[bool, typer.Option("--hinge", help="the joint is a hinge, such as a knee or an elbow")]
_ACROSS = "lateral and medial point, midway between which a hinge lies"
Across = Annotated[str, typer.Option("--across", metavar="G,H", help=_ACROSS)]
JointJson = Annotated[bool, typer.Option("--json", help="print the joint as JSON, in metres and degrees")]


def joint(
    file: File,
    parent: Parent,
    child: Child,
    hinge: Hinge = False,
    across: Across = "",
    as_json: JointJson = False,
    unit: Unit = None,
    rate: Rate = None,
    subject: Subject = None,
    frames: FrameRange = None,
) -> None:
    """Find one joint, from the markers of its two segments.

    Prints one line, and compares with joint centres that other programs left in the file. The exit code is 3 if the
    joint is not ok.
    """
    from study.recordings.formats.read import read_recording
    from study.recordings.one_joint import find_clusters, fit_one_joint, joint_json, joint_line

    if across and not hinge:
        raise typer.BadParameter("--across: only a hinge has an axis; give --hinge, too")
    recording = read_recording(file, unit=unit, rate=rate, subject=subject, frames=frames)
    answer = fit_one_joint(recording, find_clusters(recording, parent, child, across, hinge))
    if as_json:
        typer.echo(joint_json(answer))
    else:
        echo(f"note: {note}" for note in recording.notes)
        echo([joint_line(answer)])
    if not answer.ok:
        raise typer.Exit(ExitCode.TOO_MANY_FAILURES)


_FILES = "a recording, or several of one session: .c3d, .trc, .csv, .tsv or .txt"
Files = Annotated[list[Path], typer.Argument(metavar="FILE...", help=_FILES)]
_STATIC = "a trial that gives the shapes of the segments, such as a static one"
Static = Annotated[Path | None, typer.Option("--static", help=_STATIC)]
Force = Annotated[bool, typer.Option("--force", help="merge trials even if they seem to show different subjects")]


def joints(
    files: Files,
    static: Static = None,
    force: Force = False,
    hips: HipCentres = "motion",
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
    from study.recordings.formats.read import read_recording
    from study.recordings.joints import report
    from study.recordings.joints.find import save_calibration
    from study.recordings.session import fit_session, session_lines, session_table
    from study.recordings.skeleton.anatomy import regression_hint
    from study.recordings.skeleton.calibrate import with_joints
    from study.text import json_text

    if len(files) == 1 and static is None and force:
        raise typer.BadParameter("--force: there is nothing to overrule with one recording")
    every = [*files, *([] if static is None else [static])]
    if len(every) > 1 and frames is not None:
        raise typer.BadParameter(f"--frames {frames}: a range is of one recording; give one")
    recordings = [read_recording(file, unit=unit, rate=rate, subject=subject, frames=frames) for file in every]
    folder, further = results_folder("-".join(one.name for one in recordings), out), dict[str, object]()
    if len(recordings) > 1:
        match, session = fit_session(recordings, static is not None, markerset, hips, force)
        calibration, table, lines = session.calibration, session_table(session), session_lines(session)
    else:
        match, calibration = with_joints(recordings[0], None, markerset, hips)
        compared = report.agreement_table(calibration, match.recording)
        lines = chain(report.joint_lines(calibration), report.agreement_lines(compared), calibration.warnings())
        table = report.joint_table(calibration).merge(compared, on="joint")
        table["warnings"] = ["; ".join(place.warnings) for place in calibration.joints]
        further["without_pose"] = calibration.without_pose
    save_frame(table, folder / "joints.parquet")  # first: what reads the lines may stop reading, as `head` does
    paths = [folder / "joints.parquet", save_calibration(calibration, folder / "calibration.json")]
    if not as_json:
        print_match(match)
        echo([*lines, *regression_hint(calibration, match.source)])
    head = {"recording": match.source.name, "notes": list(match.source.notes), "markerset": match.data()}
    data = head | {"joints": table.to_dict("records")} | further | {"files": paths}
    echo([json_text(data)] if as_json else paths)


Set = Annotated[str | None, typer.Option("--markerset", help="all joints of a marker set, by name or file, instead")]
Udp = Annotated[
    int | None, typer.Option("--udp", metavar="PORT", help="receive datagrams at 127.0.0.1 [default: standard input]")
]
LiveUnit = Annotated[str, typer.Option("--unit", help="of the positions: m, cm, mm, in or ft")]
Every = Annotated[int, typer.Option("--every", min=1, help="frames between two answers")]


def live(
    parent: Parent = "",
    child: Child = "",
    markerset: Set = None,
    udp: Udp = None,
    unit: LiveUnit = "mm",
    every: Every = 100,
) -> None:
    """Find joints in a stream of frames.

    Each line is a frame: {"LASI": [412.1, 680.3, 966.2], "RASI": null, ...}. Prints the joints as they improve, and at
    the end of the stream or at Ctrl-C; an empty datagram ends a stream over UDP. The exit code is 3 if a joint is not
    ok.
    """
    import numpy as np

    from study.recordings.live import FrameError, lines_of_port, read_frame
    from study.recordings.recording import UNITS, unit_doubt

    if unit not in UNITS:
        raise typer.BadParameter(f"--unit {unit}: give one of {', '.join(UNITS)}")
    joints = _joints(parent, child, markerset)
    lines = (line.decode("utf-8", "replace") for line in sys.stdin.buffer)
    if udp is not None:
        lines = lines_of_port(udp, lambda words: typer.echo(words, err=True))
    before, zeros, unchecked = signal.signal(signal.SIGINT, _interrupt_once), "", True
    try:
        for number, line in enumerate(lines, start=1):
            if not line.strip():
                continue
            try:
                frame = read_frame(line, UNITS[unit])
            except FrameError as error:
                typer.echo(f"line {number} is skipped: {error}", err=True)
                continue
            places = np.array([place for place in frame.values() if place.any()])
            if unchecked and len(places) > 2:
                unchecked = False
                if doubt := unit_doubt(float(np.linalg.norm(np.ptp(places, axis=0))), unit):
                    typer.echo(doubt, err=True)
            joints.add(frame)
            if joints.zeros and not zeros:
                zeros = f"frame {joints.frames}: {', '.join(joints.zeros)} at exactly (0, 0, 0): taken for missing"
                typer.echo(f"{zeros}, there and later", err=True)
            if joints.frames == every:
                _print_lacking(joints)
            if joints.frames % every == 0:
                _print(joints)
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C that ended the sender first must not take the answer
    except KeyboardInterrupt:  # the usual end of a stream
        pass
    if joints.frames < every:
        _print_lacking(joints)
    if joints.frames % every or not joints.frames:
        _print(joints)
    if joints.jumps:
        times = f"{joints.jumps} time{'s' * (joints.jumps != 1)}"
        typer.echo(f"{times} a marker jumped; what it made wrong is left out", err=True)
    signal.signal(signal.SIGINT, before)
    if not all(answer.ok for answer in joints.answers().values()):
        raise typer.Exit(ExitCode.TOO_MANY_FAILURES)


def _interrupt_once(number: int, frame: object) -> None:
    """Interrupt the loop over frames, and nothing after it."""
    signal.signal(number, signal.SIG_IGN)
    raise KeyboardInterrupt


def _joints(parent: str, child: str, markerset: str | None) -> "LiveJoints":
    """The joints that a user asks for."""
    from study.recordings.live import LiveJoints
    from study.recordings.markersets import load_markerset

    given = [tuple(label.strip() for label in labels.split(",") if label.strip()) for labels in (parent, child)]
    if (markerset is None) == (not any(given)):
        raise typer.BadParameter("give --parent and --child for one joint, or --markerset for all of a set")
    if markerset is None:
        every = given[0] + given[1]
        if twice := [label for label in dict.fromkeys(every) if every.count(label) > 1]:
            raise typer.BadParameter(
                f"{', '.join(twice)} is named twice; name each marker once, on the segment that it is on"
            )
        if len(given[0]) < 3 or not given[1]:
            raise typer.BadParameter("--parent needs three markers, and --child one or more that are not among them")
        return LiveJoints([("joint", given[0], given[1])])
    whole = load_markerset(markerset)
    joints = [
        (j.name, [m for m in whole.segment(j.parent).markers if m not in whole.optional], whole.markers_for(j))
        for j in whole.joints
    ]
    wide = [joint for joint in joints if len(joint[1]) > 2]
    for name, markers, _ in joints:
        if len(markers) < 3:
            has = f"{len(markers)} marker{'s' * (len(markers) != 1)}"
            typer.echo(f"{name} is left out: its parent has {has}; its pose needs 3", err=True)
    if not wide:
        raise typer.BadParameter(f"--markerset {markerset}: no segment that holds a joint has three markers")
    return LiveJoints(wide)


def _print(joints: "LiveJoints") -> None:
    for name, answer in joints.answers().items():
        typer.echo(f"frame {joints.frames}: {name}: {answer.words}")


def _print_lacking(joints: "LiveJoints") -> None:
    """Name the markers that have not come, with the nearest of those that have."""
    from study.text import did_you_mean

    if joints.lacking and joints.frames:
        names, frames = ", ".join(map(repr, joints.lacking)), f"{joints.frames} frame{'s' if joints.frames > 1 else ''}"
        remedy = did_you_mean(joints.lacking, joints.labels) if joints.labels else "no frame has any marker"
        typer.echo(f"no marker of this name in {frames}: {names}; {remedy}", err=True)
