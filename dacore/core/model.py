"""Forward models: from parameters to trajectories; and the affine kind that reduces and superposes."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from dacore.core.arrays import Array, BoolArray, Sparse
from dacore.core.discretization import Discretization
from dacore.core.display import Card, Displayed, count, listed, moments
from dacore.core.fields import Field
from dacore.core.parameters import Parameters, ParameterSpace
from dacore.core.space import StateSpace
from dacore.errors import ShapeError

Coefficient = Callable[[Parameters], float]
Profile = Callable[[Array], Array]
Caution = Callable[[ParameterSpace, float], str]
Discretize = Callable[[Sequence[Field]], Discretization]


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory(Displayed):
    """States over time.

    Parameters
    ----------
    states : (n_dofs, t) array
    times : (t,) array [s]
    """

    states: Array
    times: Array

    def _card(self) -> Card:
        return Card("Trajectory", (("times", moments(self.times)), ("degrees of freedom", count(len(self.states)))))


class ForwardModel(Displayed, ABC):
    """Parameters in, trajectory out."""

    @property
    @abstractmethod
    def space(self) -> StateSpace:
        """The space the states live in."""

    @property
    @abstractmethod
    def parameters(self) -> ParameterSpace:
        """Names, units and ranges of the parameters."""

    @property
    @abstractmethod
    def times(self) -> Array:
        """Recorded times (t,) [s], the same for every parameter."""

    @abstractmethod
    def solve(self, parameters: Parameters) -> Trajectory:
        """Solve for one parameter vector; ConvergenceError if the solver fails.

        Parameters
        ----------
        parameters : mapping of str to float
            Every parameter by name.

        Returns
        -------
        Trajectory

        Raises
        ------
        ConvergenceError
            If the solver fails.
        """


@dataclass(frozen=True, eq=False, repr=False)
class AffineTerm(Displayed):
    """coefficient(θ) · matrix: one term of an affine operator.

    Parameters
    ----------
    name : str
    matrix : (n_dofs, n_dofs) csr_array
        Free of parameters; assembled once for a mesh.
    coefficient : callable
        θ -> float; a module-level function or object, so that it can be pickled.
    """

    name: str
    matrix: Sparse
    coefficient: Coefficient


@dataclass(frozen=True, eq=False, repr=False)
class Load(Displayed):
    """One cause of motion; the state is linear in its amplitude.

    It pushes and prescribes as time goes on, or it is there at t = 0 only: a state to start from
    (`Load.at_start`). A cause that does both is two loads with one amplitude.

    Parameters
    ----------
    name : str
    amplitude : callable
        θ -> float.
    profile : callable
        (t,) times [s] -> (t,) factors.
    force : (n_dofs,) array
        Right-hand side per unit of amplitude and profile.
    prescribed : (n_dofs,) array
        Values of the constrained dofs per unit of amplitude and profile, zero elsewhere.
    initial : (n_dofs,) array, optional
        State at t = 0 per unit of amplitude, on constrained dofs too, which have the values that are
        prescribed from the first step on.
    """

    name: str
    amplitude: Coefficient
    profile: Profile
    force: Array
    prescribed: Array
    initial: Array | None = None

    @classmethod
    def at_start(cls, name: str, amplitude: Coefficient, state: Array) -> "Load":
        """Return the load that is the state (n_dofs,) at t = 0, per unit of amplitude, and nothing afterwards.

        Parameters
        ----------
        name : str
        amplitude : callable
            θ -> float.
        state : (n_dofs,) array
            Per unit of amplitude.

        Returns
        -------
        Load
        """
        none = np.zeros(len(state))
        return cls(name, amplitude, at_start, none, none, state)


@dataclass(frozen=True, eq=False, repr=False)
class AffineModel(Displayed):
    """M(θ) ÿ + C(θ) ẏ + A(θ) y = F(t; θ), affine in functions of θ, linear in its loads.

    It knows no time stepping: `dacore.dynamics` marches it, reduces it and superposes its loads.

    Parameters
    ----------
    space : StateSpace
    parameters : ParameterSpace
    second_order, first_order, zeroth_order : tuple of AffineTerm
        The terms of M, C and A.
    loads : tuple of Load
    constrained : (n_dofs,) bool array
        Dofs with prescribed values (Dirichlet).
    antisymmetric : (n_dofs,) bool array
        Rows which, multiplied by −1/(factor of C in a time step), make the step symmetric; the
        rows of a flow equation coupled to a momentum balance. All False for a symmetric step.
    cautions : tuple of callables
        What to beware of before anything is solved: each says in one line what a scene with these
        ranges of the parameters, and the inverse factor of C in a step [s], has to fear, or
        nothing. Module-level functions or objects, as coefficients are.
    """

    space: StateSpace
    parameters: ParameterSpace
    second_order: tuple[AffineTerm, ...]
    first_order: tuple[AffineTerm, ...]
    zeroth_order: tuple[AffineTerm, ...]
    loads: tuple[Load, ...]
    constrained: BoolArray
    antisymmetric: BoolArray
    cautions: tuple[Caution, ...] = ()

    def __post_init__(self) -> None:
        n = self.space.n_dofs
        for name, flags in (("constrained", self.constrained), ("antisymmetric", self.antisymmetric)):
            if np.shape(flags) != (n,):
                raise ShapeError(f"{name}: got flags of shape {np.shape(flags)}, expected ({n},)")
        for term in (*self.second_order, *self.first_order, *self.zeroth_order):
            if term.matrix.shape != (n, n):
                raise ShapeError(f"term {term.name}: got shape {term.matrix.shape}, expected {(n, n)}")
        for load in self.loads:
            if load.force.shape != (n,) or load.prescribed.shape != (n,):
                raise ShapeError(
                    f"load {load.name}: got a force of shape {load.force.shape} and prescribed values of shape "
                    f"{load.prescribed.shape}, expected ({n},) for both, a number for each degree of freedom"
                )
            if load.prescribed[~self.constrained].any():
                raise ShapeError(f"load {load.name}: prescribes values of dofs that are not constrained")
            if load.initial is None:
                continue
            if load.initial.shape != (n,):
                raise ShapeError(
                    f"load {load.name}: got an initial state of shape {load.initial.shape}, expected ({n},)"
                )
            if load.force.any() or load.prescribed.any():
                raise ShapeError(
                    f"load {load.name}: got an initial state and a force or prescribed values, expected one of them; "
                    "make two loads with the same amplitude"
                )

    def _card(self) -> Card:
        free = self.parameters.free
        return Card(
            "AffineModel",
            (
                ("fields", listed([each.name for each in self.space.fields])),
                ("degrees of freedom", f"{count(self.space.n_dofs)}, {count(int(self.constrained.sum()))} prescribed"),
                ("free parameters", listed([each.name for each in free])),
                ("second order", listed([each.name for each in self.second_order])),
                ("first order", listed([each.name for each in self.first_order])),
                ("zeroth order", listed([each.name for each in self.zeroth_order])),
                ("loads", listed([each.name for each in self.loads])),
            ),
        )

    def amplitudes(self, parameters: Parameters) -> Array:
        """Amplitude (n_loads,) of each load at θ.

        Parameters
        ----------
        parameters : mapping of str to float

        Returns
        -------
        (n_loads,) array
        """
        return np.array([load.amplitude(parameters) for load in self.loads])


def at_start(times: Array) -> Array:
    """Return factors (t,) at times (t,) [s]: one at t = 0, zero afterwards; the profile of an initial state.

    Parameters
    ----------
    times : (t,) array [s]

    Returns
    -------
    (t,) array
    """
    return np.asarray(np.equal(times, 0), dtype=np.float64)


def combine(terms: Sequence[AffineTerm], parameters: Parameters, n: int) -> Sparse:
    """Σ coefficient(θ) · matrix as an (n, n) csr_array.

    Parameters
    ----------
    terms : sequence of AffineTerm
    parameters : mapping of str to float
    n : int
        Number of degrees of freedom.

    Returns
    -------
    (n, n) csr_array
    """
    total = csr_array((n, n), dtype=np.float64)
    for term in terms:
        total = total + term.coefficient(parameters) * term.matrix
    return csr_array(total)


class Physics(ABC):
    """Frozen settings of a model; a plugin class of the hook ``dacore_models``."""

    @abstractmethod
    def build(self, discretize: Discretize) -> "AffineModel | ForwardModel":
        """Build the model.

        Parameters
        ----------
        discretize : callable
            Puts a list of fields on the scene's mesh with the scene's backend; a model of its own
            kind (no mesh, no finite elements) never calls it.

        Returns
        -------
        AffineModel or ForwardModel
            An affine model is marched in time as the scene's ``[time]`` table says.
        """
