"""What it costs to start: the time before the first line of work, in fresh processes."""

import subprocess
import sys

import pytest

STARTS = {
    "import the errors": ("import dacore.errors", 0.1),
    "import the plugin door": ("import dacore.plugins", 0.15),
    "find and list every plugin": ("from dacore.plugins.registry import load; load().table()", 0.25),
    "import the command line": ("import dacore.cli.main", 1.0),
}


@pytest.mark.parametrize("name", STARTS)
def test_start(name):
    statement, limit = STARTS[name]
    code = f"import time; start = time.process_time(); {statement}; print(time.process_time() - start)"
    command = [sys.executable, "-c", code]
    seconds = min(float(subprocess.run(command, capture_output=True, check=True).stdout) for _ in range(5))
    print(f"\n{name}: {1e3 * seconds:.0f} ms of CPU (wanted: under {1e3 * limit:.0f} ms)")
    assert seconds > 0
