"""The command on a stream of frames, `study live`."""

import signal
import sys
from functools import partial
from typing import TYPE_CHECKING, Annotated, BinaryIO

import typer

from study.options import ExitCode, echo
from study.recordings.commands import Child, Parent, complain
from study.text import did_you_mean, json_text

if TYPE_CHECKING:
    from study.recordings.live import LiveJoints

_ALL = "all joints of a marker set, by name or file, instead"
_UDP = "receive datagrams at 127.0.0.1 [default: standard input]"


_LONGEST = 1 << 20
"""Bytes of a frame's line, some ten thousand markers; a stream without lines would fill the memory."""


def _piped_line(stream: BinaryIO) -> str:
    """The next line of a stream; empty at its end."""
    line = stream.readline(_LONGEST)
    if len(line) == _LONGEST:
        from study.files import InputError

        raise InputError(f"standard input: a line of {_LONGEST:,} bytes or more: give each frame a line of its own")
    return line.decode("utf-8", "replace")


def live(
    parent: Parent = "",
    child: Child = "",
    markerset: Annotated[str | None, typer.Option(help=_ALL)] = None,
    udp: Annotated[int | None, typer.Option(metavar="PORT", help=_UDP)] = None,
    unit: Annotated[str, typer.Option(help="of the positions: m, cm, mm, in or ft")] = "mm",
    every: Annotated[int, typer.Option(min=1, help="frames between two answers")] = 100,
    as_json: Annotated[bool, typer.Option("--json", help="print each answer as one line of JSON")] = False,
) -> None:
    """Find joints in a stream of frames.

    Each line is a frame: {"LASI": [412.1, 680.3, 966.2], "RASI": null, ...}. Prints the joints as they improve, and at
    the end of the stream or at Ctrl-C; an empty datagram ends one over UDP. Centres are in the parent's axes, which
    the stream has in the first frame with all of its markers, as for `study joint`. The exit code is 3 if a joint is
    not ok.

    With --json, a line for each answer: frame, joint, ok, doubt, center, error, noise, moved, samples; axes_frame, the
    frame in which the parent's axes are the stream's; and parent_markers, the place of each in these axes.
    """
    import numpy as np

    from study.recordings.live import FrameError, lines_of_port, read_frame
    from study.recordings.recording import UNITS, unit_doubt

    if unit not in UNITS:
        raise typer.BadParameter(f"--unit {unit}: give one of {', '.join(UNITS)}")
    joints = _joints(parent, child, markerset)
    piped = iter(partial(_piped_line, sys.stdin.buffer), "") if udp is None else ()
    before, zeros, unchecked = signal.signal(signal.SIGINT, _interrupt_once), "", True
    try:
        for number, line in enumerate(piped if udp is None else lines_of_port(udp, complain), start=1):
            if not line.strip():
                continue
            try:
                frame = read_frame(line, UNITS[unit])
            except FrameError as error:
                complain(f"line {number} is skipped: {error}")
                continue
            places = np.array([place for place in frame.values() if place.any()])
            if unchecked and len(places) > 2:
                unchecked = False
                if doubt := unit_doubt(float(np.linalg.norm(np.ptp(places, axis=0))), unit):
                    complain(doubt)
            joints.add(frame)
            if joints.zeros and not zeros:
                zeros = f"frame {joints.frames}: {', '.join(joints.zeros)} at exactly (0, 0, 0): taken for missing"
                complain(f"{zeros}, there and later")
            if joints.frames == every:
                _print_lacking(joints)
            if joints.frames % every == 0:
                _print(joints, as_json)
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C that ended the sender first must not take the answer
    except KeyboardInterrupt:  # the usual end of a stream
        pass
    if joints.frames < every:
        _print_lacking(joints)
    if joints.frames % every or not joints.frames:
        _print(joints, as_json)
    if joints.jumps:
        complain(f"{joints.jumps} time{'s' * (joints.jumps != 1)} a marker jumped; what it made wrong is left out")
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

    one, other = (tuple(label.strip() for label in labels.split(",") if label.strip()) for labels in (parent, child))
    if (markerset is None) == (not one + other):
        raise typer.BadParameter("give --parent and --child for one joint, or --markerset for all of a set")
    if markerset is None:
        if twice := [label for label in dict.fromkeys(one + other) if (one + other).count(label) > 1]:
            words = "is named twice; name each marker once, on the segment that it is on"
            raise typer.BadParameter(f"{', '.join(twice)} {words}")
        if len(one) < 3 or not other:
            raise typer.BadParameter("--parent needs three markers, and --child one or more that are not among them")
        return LiveJoints([("joint", one, other)])
    whole, wide = load_markerset(markerset), []
    for joint in whole.joints:
        markers = [marker for marker in whole.segment(joint.parent).markers if marker not in whole.optional]
        if len(markers) > 2:
            wide.append((joint.name, markers, whole.markers_for(joint)))
            continue
        has = f"{len(markers)} marker{'s' * (len(markers) != 1)}"
        complain(f"{joint.name} is left out: its parent has {has}; its pose needs 3")
    if not wide:
        raise typer.BadParameter(f"--markerset {markerset}: no segment that holds a joint has three markers")
    return LiveJoints(wide)


def _print(joints: "LiveJoints", as_json: bool) -> None:
    if as_json:
        echo([json_text(row, indent=None) for row in joints.data()])
        return
    for name, answer in joints.answers().items():
        typer.echo(f"frame {joints.frames}: {name}: {answer.words}")


def _print_lacking(joints: "LiveJoints") -> None:
    """Name the markers that have not come, with the nearest of those that have."""
    if joints.lacking and joints.frames:
        names, frames = ", ".join(map(repr, joints.lacking)), f"{joints.frames} frame{'s' if joints.frames > 1 else ''}"
        remedy = did_you_mean(joints.lacking, joints.labels) if joints.labels else "no frame has any marker"
        complain(f"no marker of this name in {frames}: {names}; {remedy}")
