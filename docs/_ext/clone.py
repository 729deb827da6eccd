"""A folder as a reader's clone of the repository, where tutorials run: what they write stays under `docs/_build`."""

import hashlib
import os
import shutil
import sys
from pathlib import Path

# In a notebook a command that fails is no error; on the site it must be one.
_STARTUP = """import os
import subprocess

import matplotlib

os.chdir({folder!r})
# A command writes to a page, not to a terminal.
for name in ("FORCE_COLOR", "CLICOLOR", "CLICOLOR_FORCE", "PAGER", "GIT_PAGER"):
    os.environ.pop(name, None)
os.environ.update(TERM="dumb", COLUMNS="96", PYTHONUNBUFFERED="1")
matplotlib.rcParams["figure.dpi"] = 110


def _system(command):
    line = get_ipython().var_expand(command, depth=1)
    done = subprocess.run(line, shell=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    print(done.stdout, end="")
    if done.returncode:
        raise RuntimeError(f"exit status {{done.returncode}}: {{line}}")


get_ipython().system = _system
"""


def prepare(root: Path, build: Path) -> None:
    """Make the folder, and have every notebook kernel start in it.

    Parameters
    ----------
    root : Path
        The repository.
    build : Path
        Where the site is built.
    """
    folder = _folder(build)
    folder.mkdir(parents=True, exist_ok=True)
    link = folder / "examples"
    if not link.is_symlink():
        link.symlink_to(root / "examples")
    startup = build / "ipython/profile_default/startup"
    startup.mkdir(parents=True, exist_ok=True)
    (startup / "00-clone.py").write_text(_STARTUP.format(folder=str(folder)), encoding="utf-8")
    # Kernels on this machine's loopback need not say that they are unencrypted.
    (build / "ipython/profile_default/ipython_kernel_config.py").write_text("c.IPKernelApp.log_level = 40\n")
    os.environ["IPYTHONDIR"] = str(build / "ipython")
    # `!dacore run ...` in a cell finds the command of this very environment.
    os.environ["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")


def cache(root: Path, build: Path) -> Path:
    """Where executed notebooks are kept: under a hash of all code they may run, so that none shows what was.

    What was kept under another one is removed.
    """
    digest = hashlib.sha256()
    files = [*root.glob("dacore/**/*.py"), *root.glob("plugins/*/src/**/*.py"), *root.glob("examples/**/*.toml")]
    for file in sorted(files):
        digest.update(str(file.relative_to(root)).encode())
        digest.update(file.read_bytes())
    kept = build / "executed" / digest.hexdigest()[:16]
    for old in kept.parent.glob("*"):
        if old != kept:
            shutil.rmtree(old)
    return kept


def _folder(build: Path) -> Path:
    return build / "clone"
