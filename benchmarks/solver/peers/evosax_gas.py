"""evosax's genetic algorithms and CMA-ES on JAX: a whole run, evaluation included, is one jitted scan."""

from collections.abc import Callable
from functools import cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax
from evosax import algorithms

from benchmarks.solver.peers.contest import EVALUATIONS, GENERATIONS, POPULATION, Contest, Family, Finish, Peer
from benchmarks.solver.peers.jax_fitness import losses_of
from workers.geometry.models import ModelName

_LAMBDA = 40
_STEP = 0.1
"""First mutation, as a share of the bounds. Their own default of 1 would throw every child out of the box."""


def _simple(genes: int) -> tuple[Any, Any]:
    fading = optax.exponential_decay(_STEP, GENERATIONS - 1, 0.02)
    method = algorithms.SimpleGA(POPULATION, jnp.zeros(genes), std_schedule=fading)
    return method, method.default_params.replace(crossover_rate=0.5)


def _fifth(genes: int) -> tuple[Any, Any]:
    method = algorithms.MR15_GA(POPULATION, jnp.zeros(genes))
    return method, method.default_params.replace(std_init=_STEP)


def _samr(genes: int) -> tuple[Any, Any]:
    method = algorithms.SAMR_GA(POPULATION, jnp.zeros(genes))
    return method, method.default_params.replace(std_init=_STEP)


def _gesmr(genes: int) -> tuple[Any, Any]:
    # 799 children in 17 groups of 47.
    method = algorithms.GESMR_GA(POPULATION, jnp.zeros(genes), num_groups=17)
    return method, method.default_params.replace(std_init=_STEP)


def _learned(genes: int) -> tuple[Any, Any]:
    method = algorithms.LearnedGA(POPULATION, jnp.zeros(genes))
    return method, method.default_params.replace(std_init=_STEP)


def _cmaes(genes: int) -> tuple[Any, Any]:
    method = algorithms.CMA_ES(_LAMBDA, jnp.zeros(genes))
    return method, method.default_params.replace(std_init=0.3)


Build = Callable[[int], tuple[Any, Any]]


@cache
def _compiled(build: Build, model: ModelName, genes: int) -> Callable[..., Any]:
    """A whole run: a genetic algorithm's from an evaluated population, or CMA-ES's from the middle of the bounds."""
    method, params = build(genes)
    losses = losses_of(model)

    def generation(pack: Any, numbers: Any, state: Any, key: Any) -> tuple[Any, Any]:
        ask, tell = jax.random.split(key)
        children, state = method.ask(ask, state, params)
        children = jnp.clip(children, 0.0, 1.0)
        state = method.tell(tell, children, losses(children, pack, numbers), state, params)[0]
        return state, state.best_fitness

    def begun(key: Any, pack: Any, numbers: Any) -> Any:
        if build is _cmaes:
            return method.init(key, jnp.full(genes, 0.5), params)
        first, begin = jax.random.split(key)
        population = jax.random.uniform(first, (POPULATION, genes))
        return method.init(begin, population, losses(population, pack, numbers), params)

    generations = EVALUATIONS // _LAMBDA if build is _cmaes else GENERATIONS - 1

    @jax.jit
    def search(seed: Any, pack: Any, numbers: Any) -> Any:
        begin, rest = jax.random.split(jax.random.PRNGKey(seed))
        keys = jax.random.split(rest, generations)
        state, lowest = jax.lax.scan(partial(generation, pack, numbers), begun(begin, pack, numbers), keys)
        return state.best_solution, lowest

    return search


def _run(build: Build, contest: Contest) -> Finish:
    search = _compiled(build, contest.problem.model, contest.genes)
    best, lowest = search(contest.seed % 2**31, contest.pack, contest.numbers.astype(np.float32))
    # A genetic algorithm's first population is evaluated before its first generation.
    size, begins = (_LAMBDA, 1) if build is _cmaes else (POPULATION, 2)
    trace = tuple((size * (begins + i), loss) for i, loss in enumerate(np.asarray(lowest).tolist()))
    return Finish(np.asarray(best, dtype=np.float64), EVALUATIONS, trace=trace)


_ALGORITHMS: tuple[tuple[str, Family, Build, str], ...] = (
    ("SimpleGA", "jax ga", _simple, f"best half as parents, crossover 0.5, mutation from {_STEP} down to a fiftieth"),
    ("MR15_GA", "jax ga", _fifth, f"mutation from {_STEP}, by the rule of one fifth"),
    ("SAMR_GA", "jax ga", _samr, f"mutation from {_STEP}, adapting itself"),
    ("GESMR_GA", "jax ga", _gesmr, f"mutation from {_STEP} in 17 groups, adapting themselves"),
    ("LearnedGA", "jax ga", _learned, f"the weights that come with it, mutation from {_STEP}"),
    ("CMA-ES", "evolution strategy", _cmaes, f"lambda {_LAMBDA}, sigma 0.3, clipped to the bounds"),
)
PEERS = [
    Peer(f"evosax {name}", family, settings, partial(_run, build)) for name, family, build, settings in _ALGORITHMS
]
