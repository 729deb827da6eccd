"""What the machine offers, and how much of it this process takes."""

import os
import resource
import sys
from pathlib import Path


def usable_cores() -> int:
    """Number of cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def peak_memory() -> float:
    """Peak resident memory [MiB] of this process.

    Linux's own counter for it: what ``getrusage`` says there includes the process that started this one.
    """
    own = _status("VmHWM")
    if own is not None:
        return own
    unit = 1024.0 if sys.platform != "darwin" else 1024.0**2
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit


def memory_now() -> float:
    """Resident memory [MiB] of this process; where the system does not say, its peak so far."""
    own = _status("VmRSS")
    return peak_memory() if own is None else own


def _status(key: str) -> float | None:
    try:
        text = Path("/proc/self/status").read_text(encoding="utf-8")
    except OSError:
        return None
    return next((int(line.split()[1]) / 1024.0 for line in text.splitlines() if line.startswith(f"{key}:")), None)
