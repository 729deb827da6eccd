"""Ctrl-C that is not lost where Python ignores exceptions, as in the finaliser of a dask future."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def kept_interrupts() -> Iterator[Callable[[], None]]:
    """Remember Ctrl-C, which raises KeyboardInterrupt at once as always.

    Yields
    ------
    callable
        Raises KeyboardInterrupt if Ctrl-C was pressed in this block and is still not over. Off the main thread,
        or where somebody else handles Ctrl-C, it does nothing.
    """
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or before is not signal.default_int_handler:
        yield lambda: None
        return
    pressed = False

    def note(number: int, frame: FrameType | None) -> None:
        nonlocal pressed
        pressed = True
        signal.default_int_handler(number, frame)

    def look() -> None:
        if pressed:
            raise KeyboardInterrupt

    signal.signal(signal.SIGINT, note)
    try:
        yield look
    finally:
        signal.signal(signal.SIGINT, before)
