"""What it costs to start: the time before the first line of work, in fresh processes."""

import os
import subprocess
import sys

import pytest

from dacore.plugins.registry import load

STARTS = {
    "import the errors": ("import dacore.errors", 0.1),
    "import the plugin door": ("import dacore.plugins", 0.15),
    "find and list every plugin": ("from dacore.plugins.registry import load; load().table()", 0.25),
    "import the command line": ("import dacore.cli.main", 1.0),
}

# What every backend needs is imported before the clock starts: the rest is the library's own share.
TRIANGLE = """
from dacore.core.fields import Field
from dacore.core.fespace import FiniteElementSpace
from dacore.core.mesh import Mesh
from dacore.plugins.registry import load
mesh = Mesh([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]], [[0, 1], [1, 2], [2, 0]], [1, 1, 1], {{"rim": 1}})
made = load().get("backend", {name!r})().discretize(mesh, [Field("p", 1, 1)])
import scipy.sparse.linalg
import resource, time
def now():
    spent = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return time.perf_counter(), sum(each.ru_utime + each.ru_stime for each in spent)
"""
FORM = "wall, cpu = now()\nmade.scalar_mass('p')\nprint(*(b - a for a, b in zip((wall, cpu), now())))\n"


def fresh(code, environment=None):
    """The numbers that `code` prints in a process of its own."""
    command = [sys.executable, "-c", code]
    return [
        float(word) for word in subprocess.run(command, capture_output=True, check=True, env=environment).stdout.split()
    ]


@pytest.mark.parametrize("name", STARTS)
def test_start(name):
    statement, limit = STARTS[name]
    code = f"import time; start = time.process_time(); {statement}; print(time.process_time() - start)"
    seconds = min(fresh(code)[0] for _ in range(5))
    print(f"\n{name}: {1e3 * seconds:.0f} ms of CPU (wanted: under {1e3 * limit:.0f} ms)")
    assert seconds > 0


@pytest.mark.parametrize("name", [row.name for row in load().table() if (row.kind, row.status) == ("backend", "ready")])
def test_first_form(name, tmp_path):
    """From a bare process to a matrix: the library imported and, for DOLFINx, the form compiled or found compiled."""
    code = TRIANGLE.format(name=name) + FORM
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}
    first = fresh(code, environment)
    wall, cpu = min(fresh(code, environment) for _ in range(5))
    print(f"\nload {name} and assemble the first form: {wall:.2f} s ({cpu:.2f} s of CPU)")
    print(f"  the first time on a machine: {first[0]:.2f} s ({first[1]:.2f} s of CPU)")
    assert wall > 0
