"""What a stage costs: estimated from its size before it runs, recorded after, and each corrected by the other.

An estimate is a growth law of the stage (`Stage.cost`) times what the same kind of stage took in this
cache before, relative to its law: machines differ, and so do libraries.
"""

import json
import math
import resource
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from dacore.errors import StoreError
from dacore.io.atomic import atomic_write

# Records of another set of laws say nothing about these; raise it when a law changes.
LAWS = 2
FOLDER = "costs"
# Bytes a second at which a kept result is read and checked.
READING = 4e8


@dataclass(frozen=True)
class Cost:
    """What a stage takes.

    Parameters
    ----------
    seconds : float
        Wall time.
    memory : float
        Bytes held at the worst moment.
    """

    seconds: float
    memory: float


@dataclass(frozen=True)
class Record:
    """What a stage took once.

    Parameters
    ----------
    stage : str
    seconds : float
    cpu : float
        Processor time of this process and of workers that ended [s].
    law : float
        Seconds by the stage's growth law alone; 0 where there was none.
    sizes : mapping of str to float
        How large its result is, by the names that laws use.
    laws : int
        Version of the laws.
    """

    stage: str
    seconds: float
    cpu: float
    law: float
    sizes: Mapping[str, float]
    laws: int = LAWS


@dataclass(frozen=True)
class Ledger:
    """Records of a cache, a small file each.

    Parameters
    ----------
    cache : Path
    """

    cache: Path

    def keep(self, key: str, record: Record) -> None:
        """Write the record of a stage with this key; a cache that cannot be written loses an estimate, no more."""
        try:
            with atomic_write(self._path(record.stage, key)) as stream:
                stream.write(json.dumps(asdict(record)) + "\n")
        except StoreError:
            return

    def find(self, stage: str, key: str) -> Record | None:
        """Return the record of a stage with this key; None if there is none that can be read."""
        return _read(self._path(stage, key))

    def factor(self, stage: str) -> float | None:
        """How much longer this kind of stage took than its law says: the middle of its records, None without one."""
        kind = stage.partition(".")[0]
        ratios = []
        for path in (self.cache / FOLDER).glob(f"{kind}*.json"):
            record = _read(path)
            if record is None or record.stage.partition(".")[0] != kind or record.laws != LAWS:
                continue
            if record.law > 0 and record.seconds > 0:
                ratios.append(math.log(record.seconds / record.law))
        return math.exp(sorted(ratios)[len(ratios) // 2]) if ratios else None

    def _path(self, stage: str, key: str) -> Path:
        return self.cache / FOLDER / f"{stage}-{key}.json"


def _read(path: Path) -> Record | None:
    try:
        return Record(**json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        return None


def processor_time() -> float:
    """Processor time of this process and of those it started that have ended [s]."""
    uses = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(use.ru_utime + use.ru_stime for use in uses)


def seconds_text(seconds: float) -> str:
    """About how long, in words of two digits at most: "2 s", "40 s", "6 min", "1.5 h"."""
    if seconds < 0.95:
        return "under 1 s"
    if seconds < 90:
        return f"{float(f'{seconds:.1g}' if seconds < 10 else f'{seconds:.2g}'):.0f} s"
    if seconds < 5400:
        return f"{float(f'{seconds / 60:.2g}'):g} min"
    return f"{float(f'{seconds / 3600:.2g}'):g} h"


def memory_text(size: float) -> str:
    """About how much memory: "80 MiB", "1.5 GiB"."""
    if size < 0.95 * 2**30:
        return f"{max(round(size / 2**20, -1), 10):.0f} MiB"
    return f"{float(f'{size / 2**30:.2g}'):g} GiB"


def size_on_disk(path: Path) -> int:
    """Bytes of a file; 0 if it is not there."""
    try:
        return path.stat().st_size
    except OSError:
        return 0
