"""The command `study live`: joints from a stream of frames, which improve as the frames come."""

import signal
from typing import TYPE_CHECKING, Annotated

import typer

from study.runs.commands import ExitCode

if TYPE_CHECKING:
    from study.mocap.live.growing_joints import LiveJoints

Parent = Annotated[str, typer.Option("--parent", metavar="A,B,C", help="labels of the parent's markers, three or more")]
Child = Annotated[str, typer.Option("--child", metavar="D,E,F", help="labels of the child's markers")]
Set = Annotated[str | None, typer.Option("--markerset", help="all joints of a marker set, by name or file, instead")]
Udp = Annotated[
    int | None, typer.Option("--udp", metavar="PORT", help="receive datagrams at 127.0.0.1 [default: standard input]")
]
Unit = Annotated[str, typer.Option("--unit", help="of the positions: m, cm, mm, in or ft")]
Every = Annotated[int, typer.Option("--every", min=1, help="frames between two answers")]


def live(
    parent: Parent = "",
    child: Child = "",
    markerset: Set = None,
    udp: Udp = None,
    unit: Unit = "mm",
    every: Every = 100,
) -> None:
    """Find joints in a stream of frames.

    Each line is a frame: {"LASI": [412.1, 680.3, 966.2], "RASI": null, ...}. Prints the joints as they improve, and at
    the end of the stream or at Ctrl-C; an empty datagram ends a stream over UDP. The exit code is 3 if a joint is not
    ok.
    """
    from study.mocap.io.assembly import UNITS
    from study.mocap.live.frame_lines import FrameError, lines_of_input, lines_of_port, read_frame

    if unit not in UNITS:
        raise typer.BadParameter(f"--unit {unit}: give one of {', '.join(UNITS)}")
    joints = _joints(parent, child, markerset)
    lines = lines_of_input() if udp is None else lines_of_port(udp, lambda words: typer.echo(words, err=True))
    before, zeros = signal.signal(signal.SIGINT, _interrupt_once), ""
    try:
        for number, line in enumerate(lines, start=1):
            if not line.strip():
                continue
            try:
                frame = read_frame(line, UNITS[unit])
            except FrameError as error:
                typer.echo(f"line {number} is skipped: {error}", err=True)
                continue
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
    from study.mocap.live.growing_joints import LiveJoints
    from study.mocap.markersets.set_file import load_markerset

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
    found = load_markerset(markerset)
    joints = [
        (j.name, [m for m in found.segment(j.parent).markers if m not in found.optional], found.markers_for(j))
        for j in found.joints
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
    from study.text.nearest import did_you_mean

    if joints.lacking and joints.frames:
        names, frames = ", ".join(map(repr, joints.lacking)), f"{joints.frames} frame{'s' if joints.frames > 1 else ''}"
        remedy = did_you_mean(joints.lacking, joints.labels) if joints.labels else "no frame has any marker"
        typer.echo(f"no marker of this name in {frames}: {names}; {remedy}", err=True)
