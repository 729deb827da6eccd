"""Ctrl-C is heard once more where Python ignored it."""

import os
import signal
import threading

import pytest

from dacore.execution.interrupts import kept_interrupts


class Deaf:
    """Python ignores what is raised while this is taken down."""

    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)
        sum(range(100_000))


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_an_interrupt_that_a_finaliser_swallowed_comes_at_the_next_look():
    before = signal.getsignal(signal.SIGINT)
    with kept_interrupts() as look:
        look()
        deaf = Deaf()
        del deaf
        with pytest.raises(KeyboardInterrupt):
            look()
    assert signal.getsignal(signal.SIGINT) is before


def test_an_interrupt_is_raised_at_once_as_always():
    with pytest.raises(KeyboardInterrupt), kept_interrupts():
        signal.raise_signal(signal.SIGINT)


def test_what_others_do_with_interrupts_is_left_alone():
    heard = []
    before = signal.signal(signal.SIGINT, lambda *_: heard.append(1))
    try:
        with kept_interrupts() as look:
            os.kill(os.getpid(), signal.SIGINT)
            sum(range(100_000))
            look()
    finally:
        signal.signal(signal.SIGINT, before)
    assert heard == [1]


def test_off_the_main_thread_nothing_is_handled():
    before, done = signal.getsignal(signal.SIGINT), []

    def work():
        with kept_interrupts() as look:
            look()
            done.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert done == [before]
