"""Physics that are wrong in one way each: flow through a skeleton of springs, changed."""

from dataclasses import dataclass, replace
from operator import itemgetter

import numpy as np
from scipy.sparse import csr_array

from dacore.core.fespace import FiniteElementSpace
from dacore.core.fields import Field
from dacore.core.model import AffineModel, AffineTerm, ForwardModel, Load, Physics, Trajectory
from dacore.core.parameters import Parameter, ParameterSpace
from dacore.core.timegrid import TimeGrid
from dacore.dynamics.march import MarchedModel
from dacore.dynamics.profiles import Constant, Sine
from dacore.testing import model_suite
from dacore.testing.meshes import shuffled_box
from tests.conformance.mutants import Mutant

MUTANTS = []
PARAMETERS = (("k", "1", 1.0, 2.0), ("kappa", "1", 0.1, 0.3), ("push", "Pa", 1.0, 3.0))


def square():
    return shuffled_box(2, 3)


def suite_of(cls):
    return model_suite(cls(), square, TimeGrid(0.05, 4), affine_in=("push",))


def caught_by(check, says="", also=()):
    def declare(cls):
        MUTANTS.append(Mutant(cls.__name__, lambda: suite_of(cls), (check, *also), says))
        return cls

    return declare


def one(parameters):
    return 1.0


@dataclass(frozen=True)
class Sound(Physics):
    """ü − k Δu + ∇p = 0, ṗ + ∇·u̇ − κ Δp = 0 with u held at the left and p given at the right."""

    def build(self, discretize):
        disc = discretize([Field("u", 2, 1, "cm"), Field("p", 1, 1, "Pa")])
        layout, mesh = disc.layout, disc.mesh
        u, p, n = layout.block("u"), layout.block("p"), layout.n_dofs

        def term(name, coefficient, matrix, rows, columns):
            big = np.zeros((n, n))
            big[rows, columns] = matrix.toarray() if hasattr(matrix, "toarray") else matrix
            return AffineTerm(name, csr_array(big), coefficient)

        mass, stiff = disc.scalar_mass("u").toarray(), disc.scalar_stiffness("p")
        constrained, held = np.zeros(n, dtype=bool), np.zeros(n)
        for axis in range(2):
            constrained[layout.component("u", axis).start + mesh.boundary_nodes("left")] = True
            constrained[layout.component("u", axis).start + mesh.boundary_nodes("side")] = True
        right = p.start + mesh.boundary_nodes("right")
        constrained[right] = True
        held[right] = 1.0
        force = np.zeros(n)
        force[layout.component("u", 0)] = disc.scalar_mass("u") @ np.ones(len(mesh.points))
        flow = np.zeros(n, dtype=bool)
        flow[p] = True
        model = AffineModel(
            FiniteElementSpace(disc),
            ParameterSpace(tuple(Parameter(*each) for each in PARAMETERS)),
            (term("inertia", one, np.kron(np.eye(2), mass), u, u),),
            (
                term("storage", one, mass, p, p),
                term("flow", one, -disc.gradient_coupling("p", "u").T, p, u),
            ),
            (
                term("stiffness", itemgetter("k"), disc.strain("u"), u, u),
                term("permeability", itemgetter("kappa"), stiff, p, p),
                term("pressure", one, disc.gradient_coupling("p", "u"), u, p),
            ),
            (
                Load("push", itemgetter("push"), Sine(2.0), force, np.zeros(n)),
                Load("given", one, Constant(), np.zeros(n), held),
            ),
            constrained,
            flow,
        )  # fmt: skip
        return self.change(model)

    def change(self, model):
        return model


class Forward(ForwardModel):
    """The marched model, changed by its physics."""

    def __init__(self, physics, inner):
        self.physics, self.inner, self.calls = physics, inner, 0

    space = property(lambda self: self.inner.space)
    parameters = property(lambda self: self.physics.ranges(self.inner.parameters))
    times = property(lambda self: self.physics.clock(self))

    def solve(self, parameters):
        self.calls += 1
        return self.physics.solved(self, parameters)


class SoundForward(Sound):
    def change(self, model):
        return Forward(self, MarchedModel(model, TimeGrid(0.05, 4)))

    def ranges(self, parameters):
        return parameters

    def clock(self, forward):
        return forward.inner.times

    def solved(self, forward, parameters):
        return forward.inner.solve(parameters)


def with_term(model, which, **changes):
    groups = {}
    for group in ("second_order", "first_order", "zeroth_order"):
        terms = getattr(model, group)
        groups[group] = tuple(replace(term, **changes) if term.name == which else term for term in terms)
    return replace(model, **groups)


def with_load(model, name, **changes):
    return replace(model, loads=tuple(replace(load, **changes) if load.name == name else load for load in model.loads))


@caught_by("terms_are_matrices", "the term storage is there twice")
class NameTwice(Sound):
    def change(self, model):
        return with_term(model, "flow", name="storage")


@caught_by("terms_are_matrices", "expected csr_array")
class DenseTerm(Sound):
    def change(self, model):
        term = next(each for each in model.zeroth_order if each.name == "stiffness")
        return with_term(model, "stiffness", matrix=term.matrix.tocsc())


def overwriting(parameters):
    parameters["k"] = 1.0
    return 1.0


@caught_by("coefficients_are_functions", "writes into the parameters", also=("parameters_stay",))
class CoefficientWrites(Sound):
    def change(self, model):
        return with_term(model, "inertia", coefficient=overwriting)


class Counting:
    """Another number each time."""

    def __init__(self):
        self.calls = 0

    def __call__(self, parameters):
        self.calls += 1
        return 1.0 + 1e-6 * self.calls


@caught_by("coefficients_are_functions", "for the same parameters", also=("the_same_again",))
class CoefficientRemembers(Sound):
    def change(self, model):
        return with_term(model, "inertia", coefficient=Counting())


@caught_by("models_can_be_pickled", "no lambdas")
class Lambda(Sound):
    def change(self, model):
        return with_term(model, "inertia", coefficient=lambda parameters: 1.0)


class Growing:
    """Changes the matrix it belongs to."""

    def __init__(self, matrix):
        self.matrix = matrix

    def __call__(self, parameters):
        self.matrix.data *= 1.0 + 1e-3 * parameters["k"]
        return 1.0


@caught_by("matrices_are_free_of_parameters", "the matrix of stiffness changes in a solve")
class MatrixOfTheParameters(Sound):
    def change(self, model):
        term = next(each for each in model.zeroth_order if each.name == "stiffness")
        return with_term(model, "stiffness", coefficient=Growing(term.matrix))


@caught_by("profiles_are_functions_of_time", "has shape")
class ProfileOfOneTime(Sound):
    def change(self, model):
        return with_load(model, "push", profile=lambda times: 1.0)


@caught_by("profiles_are_functions_of_time", "at times asked one by one")
class ProfileOfAllTimes(Sound):
    def change(self, model):
        return with_load(model, "push", profile=lambda times: times / times.max(initial=1e-9))


@caught_by("profiles_are_functions_of_time", "changes the times")
class ProfileShiftsTheTimes(Sound):
    def change(self, model):
        def profile(times):
            times += 1.0
            return times

        return with_load(model, "push", profile=profile)


@caught_by("flags_fit", "antisymmetric rows have mass")
class HeavyFlow(Sound):
    def change(self, model):
        return replace(model, antisymmetric=~model.antisymmetric)


@caught_by("flags_fit", "neither pushes nor prescribes")
class EmptyLoad(Sound):
    def change(self, model):
        return with_load(model, "push", force=np.zeros(model.space.n_dofs))


@caught_by("flags_fit", "the load warm neither pushes")
class StartsAtZero(Sound):
    def change(self, model):
        warm = Load.at_start("warm", one, np.zeros(model.space.n_dofs))
        return replace(model, loads=(*model.loads, warm))


@caught_by("flags_fit", "the load warm holds NaN", also=("trajectories_fit_the_space",))
class StartsNowhere(Sound):
    def change(self, model):
        warm = Load.at_start("warm", one, np.full(model.space.n_dofs, np.nan))
        return replace(model, loads=(*model.loads, warm))


class Cooling:
    """Changes the state that it starts from."""

    def __init__(self, state):
        self.state = state

    def __call__(self, parameters):
        self.state *= 0.999
        return 1.0


@caught_by("matrices_are_free_of_parameters", "the initial state of warm changes in a solve")
class StartOfTheLastSolve(Sound):
    def change(self, model):
        state = np.ones(model.space.n_dofs)
        return replace(model, loads=(*model.loads, Load.at_start("warm", Cooling(state), state)))


@caught_by("steps_are_symmetric", "a step with Newmark.* cannot be made")
class NoFlowRows(Sound):
    def change(self, model):
        return replace(model, antisymmetric=np.zeros_like(model.antisymmetric))


def off_the_middle(parameters):
    # Nor where a step is looked at when it is made.
    return 1.0 if np.isclose(parameters["k"], (1.5, 1.85)).any() else 1.001


@caught_by("steps_are_symmetric", "the step is unsymmetric by")
class UnsymmetricOffTheMiddle(Sound):
    def change(self, model):
        return with_term(model, "flow", coefficient=off_the_middle)


def soft(parameters):
    return 4e4 * (1.9 - parameters["k"])


@caught_by("steps_are_symmetric", "has the eigenvalue|vanishes")
class NegativeStiffness(Sound):
    def change(self, model):
        return with_term(model, "stiffness", coefficient=soft)


def shared(parameters):
    return parameters["k"] * (1.0 + 0.1 * parameters["push"])


@caught_by("affine_in_its_loads", "is not affine in push")
class LoadStiffens(Sound):
    def change(self, model):
        return with_term(model, "stiffness", coefficient=shared)


@caught_by("every_free_parameter_matters", "the parameter porosity changes nothing")
class UnusedParameter(Sound):
    def change(self, model):
        every = (*model.parameters.parameters, Parameter("porosity", "1", 0.1, 0.2))
        return replace(model, parameters=ParameterSpace(every))


@caught_by("builds_a_model", "has no unit")
class NoUnit(Sound):
    def change(self, model):
        return replace(
            model, parameters=ParameterSpace(tuple(replace(p, unit="") for p in model.parameters.parameters))
        )


@caught_by("builds_a_model", "builds a tuple|dict")
class BuildsSomethingElse(Sound):
    def change(self, model):
        return {"model": model}


@caught_by("built_the_same_again", "when the model is built again")
class BuiltAtRandom(Sound):
    def change(self, model):
        factor = 1.0 + 1e-3 * np.random.default_rng().random()
        term = next(each for each in model.zeroth_order if each.name == "stiffness")
        return with_term(model, "stiffness", matrix=factor * term.matrix)


@caught_by("times_stay", "times change after a solve|times of its own")
class ClockMoves(SoundForward):
    def clock(self, forward):
        return forward.inner.times + 0.05 * forward.calls


@caught_by("times_stay", "has times of its own")
class TimesOfItsOwn(SoundForward):
    def solved(self, forward, parameters):
        made = forward.inner.solve(parameters)
        return Trajectory(made.states, parameters["k"] * made.times)


@caught_by("trajectories_fit_the_space", "expected")
class TimesFirst(SoundForward):
    def solved(self, forward, parameters):
        made = forward.inner.solve(parameters)
        return Trajectory(made.states.T, made.times)


@caught_by("trajectories_fit_the_space", "at the upper ends of the ranges hold NaN")
class DivergesAtTheEnd(SoundForward):
    def solved(self, forward, parameters):
        made = forward.inner.solve(parameters)
        return (
            Trajectory(made.states / (parameters["k"] < 2.0), made.times)
            if parameters["k"] < 2.0
            else Trajectory(made.states * np.nan, made.times)
        )


@caught_by("the_same_again", "after another")
class StartsFromTheLast(SoundForward):
    def solved(self, forward, parameters):
        made = forward.inner.solve(parameters)
        before = getattr(forward, "last", 0.0)
        forward.last = made.states
        return Trajectory(made.states + 1e-9 * before, made.times)


@caught_by("the_same_again", "when an earlier trajectory is overwritten")
class KeepsTrajectories(SoundForward):
    def solved(self, forward, parameters):
        kept = forward.__dict__.setdefault("kept", {})
        key = tuple(sorted(parameters.items()))
        if key not in kept:
            kept[key] = forward.inner.solve(parameters)
        return kept[key]


@caught_by("the_same_again", "in another order|given in")
class ParametersByPosition(SoundForward):
    def solved(self, forward, parameters):
        values = dict(zip(forward.parameters.names, parameters.values()))
        return forward.inner.solve(values)


@caught_by("parameters_stay", "k is")
class OverwritesParameters(SoundForward):
    def solved(self, forward, parameters):
        made = forward.inner.solve(dict(parameters))
        if isinstance(parameters, dict):
            parameters["k"] = 0.0
        return made


@caught_by("models_can_be_pickled", "after pickling")
class ForgetsInPickling(SoundForward):
    def change(self, model):
        return Forgetful(self, MarchedModel(model, TimeGrid(0.05, 4)))


class Forgetful(Forward):
    factor = 2.0

    def __reduce__(self):
        return Forward, (SoundForward(), self.inner)

    def solve(self, parameters):
        made = self.inner.solve(parameters)
        return Trajectory(self.factor * made.states, made.times)


@caught_by("affine_in_its_loads", "is not affine in push")
class SquareOfTheLoad(SoundForward):
    def solved(self, forward, parameters):
        made = forward.inner.solve(parameters)
        return Trajectory(made.states * (1.0 + 1e-4 * parameters["push"]), made.times)
