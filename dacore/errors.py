"""The exceptions of dacore, all in one tree.

::

    DacoreError
    ├── SceneError              a scene file or a ``--set`` value is wrong
    ├── PluginError             a plugin could not be loaded, or does not keep its contract
    │   └── MissingDependencyError (ImportError)   an optional library is not installed
    ├── MeshError               a mesh is not a usable domain
    ├── ShapeError (ValueError) an array has the wrong shape, type or values
    ├── CapabilityError         a state space cannot do what was asked of it
    ├── UnstableError           β(V_n, W) ≈ 0, or a time scheme outside its stability region
    ├── ConvergenceError        a solver did not reach its tolerance
    ├── AccuracyError           an algorithm's check of its own result failed
    ├── WorkerError             workers could not be had, or died at their work
    └── StoreError              a file could not be read or written

Every message says what was given, what was expected and what to do about it.
"""


class DacoreError(Exception):
    """Base class of every error dacore raises on purpose."""


class SceneError(DacoreError):
    """A scene is wrong: names the file, the key, what was given and what is allowed."""


class PluginError(DacoreError):
    """A plugin could not be loaded or does not keep its contract."""


class MissingDependencyError(PluginError, ImportError):
    """An optional library is not installed; the message says how to install it."""


class MeshError(DacoreError):
    """A mesh cannot serve as a domain."""


class ShapeError(DacoreError, ValueError):
    """An array has the wrong shape, type or values."""


class CapabilityError(DacoreError):
    """A state space lacks a capability that an observation or quantity needs."""


class UnstableError(DacoreError):
    """The stability constant vanishes, or a time scheme is outside its stability region."""


class ConvergenceError(DacoreError):
    """A solver did not reach its tolerance."""


class AccuracyError(DacoreError):
    """An algorithm's check of its own result failed."""


class WorkerError(DacoreError):
    """Worker processes could not be had, do not fit the run, or died at their work."""


class StoreError(DacoreError):
    """A file is missing, damaged, foreign, or could not be written."""
