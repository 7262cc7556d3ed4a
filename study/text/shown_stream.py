"""Text streams that show control characters instead of sending them to the terminal."""

from typing import Any, TextIO, cast

_SAFE = "\t\n"
_CONTROLS = [*range(0x20), *range(0x7F, 0xA0), *range(0x202A, 0x202F), *range(0x2066, 0x206A)]
_SHOWN = {code: f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" for code in _CONTROLS if chr(code) not in _SAFE}
"""What is printed for characters that move the cursor, colour, or turn the direction of text."""


class ShownStream:
    r"""A text stream that prints ``\x1b`` where a file name or a marker's label would send an escape sequence.

    Args:
        stream: the stream that is written to; all else that a stream has is its own, but for its buffer, through which
            bytes would pass unseen.
    """

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream

    def write(self, text: str) -> int:
        """Write a text; returns its length."""
        self.stream.write(text if text.isprintable() else text.translate(_SHOWN))
        return len(text)

    def writelines(self, lines: list[str]) -> None:
        """Write several texts."""
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        if name == "buffer":
            raise AttributeError("a stream of shown text has no buffer")
        return getattr(self.stream, name)


def shown(stream: TextIO) -> TextIO:
    """A stream that shows control characters; the same if it does already."""
    return stream if isinstance(stream, ShownStream) else cast(TextIO, ShownStream(stream))


def unchanged(stream: Any) -> Any:
    """The stream itself, for a progress bar, which moves the cursor."""
    return stream.stream if isinstance(stream, ShownStream) else stream
